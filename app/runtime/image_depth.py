"""The imaging depth of a session's ultrasound: those that are listed, and the one in use."""

from dataclasses import dataclass, replace

from app.case import Case
from app.geometry import InputError


@dataclass(frozen=True, slots=True)
class ImageDepth:
    """The listed depths, ascending, and the one by whose calibration new images are placed."""

    depths_mm: tuple[float, ...]
    depth_mm: float

    def chosen(self, depth_mm: float) -> "ImageDepth":
        """The same depths with ``depth_mm`` in use. Raises `InputError` for one not listed."""
        if depth_mm not in self.depths_mm:
            listed = ", ".join(f"{each:g}" for each in self.depths_mm)
            raise InputError(f"depth of the images: {depth_mm:g} mm; expected one of {listed}")
        return replace(self, depth_mm=depth_mm)


def image_depth_of(case: Case) -> ImageDepth | None:
    """The depths of ``case`` at its start; None for one without several calibrations."""
    entry = case.manifest.images
    if entry is None or entry.depth_mm is None:
        return None
    depths_mm = sorted(each.depth_mm or 0.0 for each in entry.calibrations)
    return ImageDepth(tuple(depths_mm), entry.depth_mm)
