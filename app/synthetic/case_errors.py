"""Errors of what a case is given beside the tracker: contour, calibrations, encoders, clock.

All are constant over a case and drawn once. Lengths are exact: a calibration error of 0.4 mm has a
random direction and a length of 0.4 mm.
"""

from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, InputError, Transform
from app.synthetic.tumour import Tumour, icosphere

CONTOUR_LOBES = 60
CONTOUR_SHARPNESS = (4.0, 12.0)
"""Lobes of the contour's error: about 60 to 25 degrees wide, as a hand draws them."""


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
            value, limit = getattr(self, part.name), _LIMITS[part.name]
            if not 0.0 <= value <= limit:
                raise InputError(f"case errors: {part.name} is {value:g}; expected 0 to {limit:g}")


_LIMITS = {
    "contour_mm": 3.0,
    "tip_mm": 3.0,
    "tip_rad": 0.05,
    "needle_mm": 3.0,
    "encoder_step_rad": 0.01,
    "encoder_offset_rad": 0.01,
    "clock_s": 0.02,
}

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
