"""The stylus of a session: where its tip is and what is drawn of it. No decision depends on it."""

from dataclasses import dataclass, field, replace

import numpy as np

from app.case import MAX_STYLUS_SIGMA_MM, MIN_STYLUS_MM, Case
from app.geometry import FrameError, InputError, SurfaceMesh, Transform
from app.runtime.pointed_rod import pointed_rod

_RADIUS_MM, _POINT_MM, _MAX_LENGTH_MM = 2.0, 15.0, 150.0


@dataclass(frozen=True, slots=True, eq=False)
class Stylus:
    """A stylus whose sensor is tracked as ``frame``.

    ``frame_from_tip`` is the tip in that frame, +z forward; None while it is not calibrated.
    ``sigma_mm``: standard deviation of the tip in its worst direction, 0 where it is not stated.
    ``surface``, in the frame of the tip, is what is drawn; None without a tip.
    """

    frame: str
    frame_from_tip: Transform | None = None
    sigma_mm: float = 0.0
    surface: SurfaceMesh | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        if self.frame_from_tip is not None:
            length_mm = float(np.linalg.norm(self.frame_from_tip.translation_mm))
            rod = min(length_mm, _MAX_LENGTH_MM), _RADIUS_MM, _POINT_MM
            object.__setattr__(self, "surface", pointed_rod(*rod, self.tip_frame))

    @property
    def tip_frame(self) -> str:
        """The frame of the tip and of the surface."""
        return f"{self.frame}_tip"

    @property
    def tip(self) -> Transform:
        """``frame_from_tip``. Raises `InputError` for a stylus that is not calibrated."""
        if self.frame_from_tip is None:
            raise InputError("stylus: it is not calibrated; expected a pivot calibration before")
        return self.frame_from_tip

    def with_tip(self, frame_from_tip: Transform, sigma_mm: float) -> "Stylus":
        """The same stylus with a calibrated tip.

        Raises `FrameError` for a tip between other frames, and `InputError` for one at the
        sensor's origin or with an uncertainty out of range.
        """
        if (frame_from_tip.target, frame_from_tip.source) != (self.frame, self.tip_frame):
            raise FrameError(
                f"stylus: the tip is {frame_from_tip.target}_from_{frame_from_tip.source}; "
                f"expected {self.frame}_from_{self.tip_frame}"
            )
        length_mm = float(np.linalg.norm(frame_from_tip.translation_mm))
        if length_mm < MIN_STYLUS_MM:
            raise InputError(
                f"stylus: the tip is {length_mm:.3g} mm from the sensor's origin; expected "
                f"{MIN_STYLUS_MM:g} mm or more"
            )
        if not 0.0 <= sigma_mm <= MAX_STYLUS_SIGMA_MM:
            raise InputError(
                f"uncertainty of the stylus' tip: is {sigma_mm:.6g} mm; expected 0 to "
                f"{MAX_STYLUS_SIGMA_MM:g} mm"
            )
        return replace(self, frame_from_tip=frame_from_tip, sigma_mm=sigma_mm)


def stylus_of(case: Case) -> Stylus | None:
    """The stylus of ``case``; None without one."""
    entry = case.manifest.stylus
    return None if entry is None else Stylus(entry.frame, entry.frame_from_tip, entry.sigma_mm)
