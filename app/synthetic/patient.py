"""Options of the simulated patient: breathing, and shape and place of the tumour."""

from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, InputError
from app.synthetic.tumour import SEMI_AXES_MM, Tumour

USUAL_BREATH_MM = 4.44
"""Length of the tissue's shift at full inspiration of a case without ``breath_mm``."""


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
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise InputError(f"patient: {name} is {value:g}; expected {low:g} to {high:g}")

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

USUAL_PATIENT = PatientOptions()
