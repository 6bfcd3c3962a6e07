"""Options of a simulated case: tracker, errors, patient, surgeon, duration, size of the tumour.

The errors are those of what a case is given beside the tracker: contour, calibrations, encoders,
clock. All are constant over a case and drawn once. Lengths are exact: a calibration error of 0.4 mm
has a random direction and a length of 0.4 mm.

The effects of a surgeon's skill are assumptions without a public source. They are linear in it: an
expert (1) enters the tumour less often and less deeply, works faster and more evenly.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import NS_PER_S, FloatArray, Transform
from app.synthetic.tracker_model import WHITE, TrackerModel, check_range, tracker_preset
from app.synthetic.tumour_and_tool import SEMI_AXES_MM, Tumour, icosphere

CONTOUR_LOBES = 60
CONTOUR_SHARPNESS = (4.0, 12.0)
"""Lobes of the contour's error: about 60 to 25 degrees wide, as a hand draws them."""
_LIMITS = {
    "contour_mm": 3.0,
    "tip_mm": 3.0,
    "tip_rad": 0.05,
    "needle_mm": 3.0,
    "encoder_step_rad": 0.01,
    "encoder_offset_rad": 0.01,
    "clock_s": 0.02,
}
USUAL_BREATH_MM = 4.44
"""Length of the tissue's shift at full inspiration of a case without ``breath_mm``."""
PATIENT_RANGES = {
    "breath_mm": (0.0, 12.0),
    "breath_hz": (0.1, 0.5),
    "elongation": (1.0, 2.0),
    "irregularity": (0.0, 1.25),
    "x_mm": (-10.0, 10.0),
    "y_mm": (-10.0, 10.0),
    "z_mm": (-10.0, 10.0),
}
"""Field -> allowed values."""
SKILL_RANGE = (0.0, 1.0)
_ENTRIES_SPARED = 0.8
"""Share of the planned entries into the tumour that an expert does not make."""
_DEEPER = 0.6
_SLOWER = 0.5
_WANDER_DEG = 8.0
_WANDER_MM = 3.0
"""Excess of a novice: entries deeper by up to this share, strokes longer by this share, and poses
of a stroke off by up to this angle around the tumour and this distance away from it."""
MIN_DURATION_S = 50.0
MAX_DURATION_S = 90.0 * 60.0
MIN_RATE_HZ = 20.0
"""A crossing at 45 mm/s has a sample every 2.3 mm."""
MAX_RATE_HZ = 250.0
MIN_TUMOR_MM = 8.0
MAX_TUMOR_MM = 40.0


@dataclass(frozen=True, slots=True)
class CaseErrors:
    """Sizes of the errors; zero is none.

    ``contour_mm``: RMS distance along the rays between the case's tumour and the true one.
    ``tip_mm``, ``tip_rad``: error of the tool's pivot and spin calibration. ``needle_mm``: error of
    the tumour's place in the needle. ``encoder_step_rad``: resolution of the joints;
    ``encoder_offset_rad``: size of each joint's constant error, with a random sign (m for prismatic
    joints). ``clock_s``: error of the calibrated offset between the clocks.
    """

    contour_mm: float = 0.0
    tip_mm: float = 0.0
    tip_rad: float = 0.0
    needle_mm: float = 0.0
    encoder_step_rad: float = 0.0
    encoder_offset_rad: float = 0.0
    clock_s: float = 0.0

    def __post_init__(self) -> None:
        for part in fields(self):
            limit = _LIMITS[part.name]
            check_range(f"case errors: {part.name}", getattr(self, part.name), 0.0, limit)


NO_ERRORS = CaseErrors()


def typical_errors(tumor_mm: float | None) -> CaseErrors:
    """Assumed sizes for a careful set-up, without a public source.

    The contour of a small tumour is drawn at a larger scale: 2.5 % of its diameter, 0.4 mm at most.
    """
    return CaseErrors(
        contour_mm=0.4 if tumor_mm is None else min(0.4, 0.025 * tumor_mm),
        tip_mm=0.3,
        tip_rad=float(np.deg2rad(0.3)),
        needle_mm=0.3,
        encoder_step_rad=2.0 * float(np.pi) / 16384.0,
        encoder_offset_rad=float(np.deg2rad(0.03)),
        clock_s=0.002,
    )


def contoured(tumour: Tumour, rms_mm: float, random: np.random.Generator) -> tuple[Tumour, float]:
    """The tumour as it is contoured, and its largest error in mm along a ray.

    The error is a smooth sum of lobes with the RMS ``rms_mm`` over all directions.
    """
    if not rms_mm:
        return tumour, 0.0
    centres = random.normal(size=(CONTOUR_LOBES, 3))
    centres /= np.linalg.norm(centres, axis=1, keepdims=True)
    heights = random.normal(size=CONTOUR_LOBES)
    sharpness = random.uniform(*CONTOUR_SHARPNESS, size=CONTOUR_LOBES)
    directions, _ = icosphere(4)
    before = tumour.radius_mm(directions)

    def with_lobes(scale: float) -> Tumour:
        return Tumour(
            tumour.semi_axes_mm,
            np.concatenate([tumour.lobe_centres, centres]),
            np.concatenate([tumour.lobe_heights, scale * heights]),
            np.concatenate([tumour.lobe_sharpness, sharpness]),
        )

    # The radius is linear in the heights of the lobes.
    unit = with_lobes(1.0).radius_mm(directions) - before
    scale = rms_mm / float(np.sqrt(np.mean(unit**2)))
    return with_lobes(scale), float(np.abs(scale * unit).max())


def wrong_pose(
    pose: Transform, length_mm: float, angle_rad: float, random: np.random.Generator
) -> Transform:
    """``pose`` with an error of this length and of this angle, in random directions."""
    shift, axis = (vector / np.linalg.norm(vector) for vector in random.normal(size=(2, 3)))
    turn = Rotation.from_rotvec(angle_rad * axis).as_matrix()
    return Transform(
        pose.target, pose.source, pose.rotation @ turn, pose.translation_mm + length_mm * shift
    )


class Encoders:
    """Joint positions as encoders report them: with a constant offset, in steps."""

    def __init__(self, errors: CaseErrors, count: int, random: np.random.Generator) -> None:
        self._step = errors.encoder_step_rad
        self._offsets = errors.encoder_offset_rad * random.choice([-1.0, 1.0], size=count)

    def read(self, positions: FloatArray) -> FloatArray:
        """The reported positions (..., n) of true ``positions`` (..., n)."""
        reported = positions + self._offsets
        if self._step:
            reported = np.round(reported / self._step) * self._step
        return np.asarray(reported)


@dataclass(frozen=True, slots=True)
class PatientOptions:
    """Differences between patients; the defaults are those of the usual simulated case.

    ``breath_mm``: shift of the tumour at full inspiration; the chest reference moves in proportion.
    ``elongation``: longest semi-axis over the geometric mean of the other two, at the same volume;
    None keeps 1.28. ``irregularity``: factor to the heights of the lobes; 0 is an ellipsoid.
    ``x_mm``, ``y_mm``, ``z_mm``: place of the tumour relative to the usual one, in axes of the
    robot's base (x away from the robot, z up).
    """

    breath_mm: float = USUAL_BREATH_MM
    breath_hz: float = 0.25
    elongation: float | None = None
    irregularity: float = 1.0
    x_mm: float = 0.0
    y_mm: float = 0.0
    z_mm: float = 0.0

    def __post_init__(self) -> None:
        for name, (low, high) in PATIENT_RANGES.items():
            check_range(f"patient: {name}", getattr(self, name), low, high)

    @property
    def breath_scale(self) -> float:
        """Motion of the bodies over the usual one."""
        return self.breath_mm / USUAL_BREATH_MM

    @property
    def place_mm(self) -> FloatArray:
        """The place (3,) relative to the usual one."""
        return np.array([self.x_mm, self.y_mm, self.z_mm])

    def shaped(self, tumour: Tumour) -> Tumour:
        """``tumour`` with the elongation and the irregularity of these options."""
        axes = tumour.semi_axes_mm
        if self.elongation is not None:
            _, second, third = SEMI_AXES_MM
            size = float(np.prod(SEMI_AXES_MM)) ** (1.0 / 3.0)
            across = size * self.elongation ** (-1.0 / 3.0)
            flat = float(np.sqrt(second / third))
            axes = np.array([size * self.elongation ** (2.0 / 3.0), across * flat, across / flat])
        return Tumour(
            axes,
            tumour.lobe_centres,
            self.irregularity * tumour.lobe_heights,
            tumour.lobe_sharpness,
        )


USUAL_PATIENT = PatientOptions()


@dataclass(frozen=True, slots=True)
class SurgeonOptions:
    """Skill from 0 (novice) to 1 (expert), and whether an ideal fixture stops the tool.

    Without a skill every case has its three entries, at the usual pace. With ``fixture`` the tool
    stops before the tumour where it would enter it: at 1 mm and the bound of the margin's error.
    """

    skill: float | None = None
    fixture: bool = False

    def __post_init__(self) -> None:
        check_range("skill", self.skill, *SKILL_RANGE)

    @property
    def pace(self) -> float:
        """Duration of the strokes over the usual one."""
        return 1.0 + _SLOWER * self._lack

    def enters(self, random: np.random.Generator) -> bool:
        """True if a planned entry happens."""
        return self.skill is None or bool(random.random() >= _ENTRIES_SPARED * self.skill)

    def depth_factor(self, random: np.random.Generator) -> float:
        """Depth of an entry over the usual one."""
        return 1.0 if self.skill is None else float(random.uniform(1.0, 1.0 + _DEEPER * self._lack))

    def wander(self, random: np.random.Generator) -> tuple[float, float]:
        """Error of a pose of a stroke: in degrees around the tumour, in mm away from it."""
        if self.skill is None:
            return 0.0, 0.0
        degrees = float(random.uniform(-1.0, 1.0)) * _WANDER_DEG * self._lack
        return degrees, float(random.random()) * _WANDER_MM * self._lack

    @property
    def _lack(self) -> float:
        return 0.0 if self.skill is None else 1.0 - self.skill


USUAL_SURGEON = SurgeonOptions()


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
        check_range("duration", self.duration_s, MIN_DURATION_S, MAX_DURATION_S, " s")
        check_range("rate", self.tracker.rate_hz, MIN_RATE_HZ, MAX_RATE_HZ, " Hz")
        check_range("tumour", self.tumor_mm, MIN_TUMOR_MM, MAX_TUMOR_MM, " mm")

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


def offset_ns(true_offset_ns: int, options: CaseOptions) -> int:
    """The calibrated offset from the robot's clock to the stamps: with latency and its error."""
    added_s = options.tracker.latency_s + options.errors.clock_s
    return true_offset_ns + round(added_s * NS_PER_S)
