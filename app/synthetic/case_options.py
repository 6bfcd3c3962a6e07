"""Options of a simulated case: tracker, errors, patient, surgeon, duration, size of the tumour."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from app.geometry import NS_PER_S, InputError
from app.synthetic.case_errors import NO_ERRORS, CaseErrors, typical_errors
from app.synthetic.patient import USUAL_PATIENT, PatientOptions
from app.synthetic.presets import WHITE, tracker_preset
from app.synthetic.surgeon import USUAL_SURGEON, SurgeonOptions
from app.synthetic.tracker_model import TrackerModel

MIN_DURATION_S = 50.0
MAX_DURATION_S = 90.0 * 60.0
MIN_RATE_HZ = 20.0
"""A crossing at 45 mm/s has a sample every 2.3 mm."""
MAX_RATE_HZ = 250.0
MIN_TUMOR_MM = 8.0
MAX_TUMOR_MM = 40.0


@dataclass(frozen=True, slots=True)
class CaseOptions:
    """Options of a simulation: tracker, errors, patient, surgeon, duration in s, diameter in mm.

    Without a duration the case is the shortest that does everything at a calm pace, about 75 s;
    without a largest diameter the tumour has 25 to 35 mm.
    """

    tracker: TrackerModel = WHITE
    errors: CaseErrors = NO_ERRORS
    duration_s: float | None = None
    tumor_mm: float | None = None
    patient: PatientOptions = USUAL_PATIENT
    surgeon: SurgeonOptions = USUAL_SURGEON

    def __post_init__(self) -> None:
        _check("duration", self.duration_s, MIN_DURATION_S, MAX_DURATION_S, "s")
        _check("rate", self.tracker.rate_hz, MIN_RATE_HZ, MAX_RATE_HZ, "Hz")
        _check("tumour", self.tumor_mm, MIN_TUMOR_MM, MAX_TUMOR_MM, "mm")

    @classmethod
    def of_tracker(cls, name: str, tumor_mm: float | None = None) -> "CaseOptions":
        """The preset of a tracker; all but ``white`` with typical errors of the case."""
        tracker = tracker_preset(name)
        errors = CaseErrors() if tracker == WHITE else typical_errors(tumor_mm)
        return cls(tracker, errors, tumor_mm=tumor_mm)

    def with_values(self, values: Mapping[str, float]) -> "CaseOptions":
        """A copy with other values, named as ``tumor_mm`` or ``tracker.white.position_rms_mm``.

        Raises `InputError` for a value out of range.
        """
        changed = self
        for path, value in values.items():
            changed = _with_value(changed, path.split("."), value)
        return changed

    @property
    def stale_after_ms(self) -> int:
        """Age at which data are stale: three periods of the tracker, 60 ms or more."""
        return max(60, int(np.ceil(3000.0 * self.tracker.period_s)))


def _with_value(owner: Any, path: list[str], value: float) -> Any:
    name, *rest = path
    return replace(
        owner, **{name: _with_value(getattr(owner, name), rest, value) if rest else value}
    )


def _check(what: str, value: float | None, low: float, high: float, unit: str) -> None:
    if value is not None and not low <= value <= high:
        raise InputError(f"{what} is {value:g} {unit}; expected {low:g} to {high:g} {unit}")


def offset_ns(true_offset_ns: int, options: CaseOptions) -> int:
    """The calibrated offset from the robot's clock to the stamps: with latency and its error."""
    added_s = options.tracker.latency_s + options.errors.clock_s
    return true_offset_ns + round(added_s * NS_PER_S)
