"""Cases of a cohort, recorded or simulated: ranges of options, from which a simulated one draws.

Each value of each case is drawn from a random stream of its own: a case does not depend on how many
others there are, and one range does not change the values of another.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from app.geometry import InputError
from app.synthetic import CaseOptions


@dataclass(frozen=True, slots=True)
class SyntheticCase:
    """Seed and options of a simulated case.

    ``values``: names and values for `CaseOptions.with_values`, in a fixed order.
    """

    seed: int
    tracker: str
    values: tuple[tuple[str, float], ...]
    fixture: bool

    def options(self) -> CaseOptions:
        """The options; raises `InputError` for a value out of range."""
        values = dict(self.values)
        chosen = CaseOptions.of_tracker(self.tracker, values.get("tumor_mm")).with_values(values)
        return replace(chosen, surgeon=replace(chosen.surgeon, fixture=self.fixture))


@dataclass(frozen=True, slots=True)
class CohortCase:
    """A case and what it is compared by.

    Exactly one of ``source`` (path or URL of a case folder) and ``synthetic`` is given. ``group``
    names one side of a comparison, ``pair`` joins a case of each side, ``surgeon`` names who
    operated; an empty text is an unknown one. ``tip_only``: the tool is measured by its tip alone.
    """

    name: str
    source: str = ""
    synthetic: SyntheticCase | None = None
    group: str = ""
    surgeon: str = ""
    pair: str = ""
    tip_only: bool = False


Fixture = Literal["off", "on", "paired", "alternate"]
FIXTURES: tuple[Fixture, ...] = ("off", "on", "paired", "alternate")

Range = tuple[float, float]
_DECIMALS = 6


@dataclass(frozen=True, slots=True)
class OptionRange:
    """An option that a manifest may give a range of: the value it sets, and its limits."""

    field: str
    low: float
    high: float
    description: str


OPTION_RANGES = {
    "duration_s": OptionRange("duration_s", 50.0, 5400.0, "length; default: about 75 s"),
    "tumor_mm": OptionRange("tumor_mm", 8.0, 40.0, "largest diameter of the tumour"),
    "elongation": OptionRange(
        "patient.elongation", 1.0, 2.0, "tumour's longest semi-axis over the mean of the others"
    ),
    "irregularity": OptionRange("patient.irregularity", 0.0, 1.25, "height of the tumour's lobes"),
    "tumor_x_mm": OptionRange("patient.x_mm", -10.0, 10.0, "place, away from the robot"),
    "tumor_y_mm": OptionRange("patient.y_mm", -10.0, 10.0, "place, to the robot's left"),
    "tumor_z_mm": OptionRange("patient.z_mm", -10.0, 10.0, "place, upwards"),
    "breath_mm": OptionRange("patient.breath_mm", 0.0, 12.0, "tumour's shift by the breath"),
    "breath_hz": OptionRange("patient.breath_hz", 0.1, 0.5, "breaths per second"),
    "skill": OptionRange("surgeon.skill", 0.0, 1.0, "0 novice, 1 expert; drawn for each surgeon"),
    "rate_hz": OptionRange("tracker.rate_hz", 20.0, 250.0, "rate of the tracker"),
    "slow_mm": OptionRange(
        "tracker.slow.position_rms_mm", 0.0, 5.0, "correlated jitter of the tracker, RMS"
    ),
    "contour_mm": OptionRange("errors.contour_mm", 0.0, 3.0, "error of the contour, RMS"),
    "tip_mm": OptionRange("errors.tip_mm", 0.0, 3.0, "error of the tip's calibration"),
    "needle_mm": OptionRange("errors.needle_mm", 0.0, 3.0, "error of the tumour's place"),
}
"""Key of a manifest -> option; the position in this table is the number of its random stream."""

_OF_SURGEON = "skill"
_TRACKER, _SURGEON, _SEED, _FIRST_RANGE = 1, 2, 3, 100


@dataclass(frozen=True, slots=True)
class Design:
    """``count`` simulated cases, drawn with ``seed``.

    ``fixture``: ``paired`` makes two cases of every draw, one without and one with the virtual
    fixture; ``alternate`` gives it to every second case. ``ranges``: values are uniform between low
    and high, both included.
    """

    count: int
    seed: int
    trackers: tuple[str, ...] = ("white",)
    surgeons: int = 8
    fixture: Fixture = "paired"
    ranges: Mapping[str, Range] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for key, (low, high) in self.ranges.items():
            allowed = OPTION_RANGES[key]
            if not allowed.low <= low <= high <= allowed.high:
                raise InputError(
                    f"{key} is [{low:g}, {high:g}]; expected a low and a high value within "
                    f"{allowed.low:g} to {allowed.high:g}"
                )

    def case(self, index: int) -> CohortCase:
        """The case ``index``, 0 to ``count - 1``."""
        if not 0 <= index < self.count:
            raise InputError(f"case {index}; expected 0 to {self.count - 1}")
        draw = index // 2 if self.fixture == "paired" else index
        surgeon = int(self._random(_SURGEON, draw).integers(self.surgeons))
        values = []
        for stream, (key, option) in enumerate(OPTION_RANGES.items()):
            if key in self.ranges:
                drawn_for = surgeon if key == _OF_SURGEON else draw
                value = self._random(_FIRST_RANGE + stream, drawn_for).uniform(*self.ranges[key])
                values.append((option.field, round(float(value), _DECIMALS)))
        fixture = self.fixture == "on" or (self.fixture != "off" and index % 2 == 1)
        compared = self.fixture in ("paired", "alternate")
        return CohortCase(
            name=f"case_{index:0{self.digits}d}",
            synthetic=SyntheticCase(
                seed=int(self._random(_SEED, draw).integers(2**31)),
                tracker=str(self._random(_TRACKER, draw).choice(self.trackers)),
                values=tuple(values),
                fixture=fixture,
            ),
            group=("fixture_on" if fixture else "fixture_off") if compared else "",
            surgeon=f"surgeon_{surgeon + 1:02d}",
            pair=f"pair_{draw:0{self.digits}d}" if self.fixture == "paired" else "",
        )

    @property
    def digits(self) -> int:
        """Digits of the numbers in names."""
        return max(4, len(str(self.count - 1)))

    def _random(self, stream: int, number: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, stream, number])
