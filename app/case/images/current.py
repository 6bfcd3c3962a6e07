"""Current image of a page, recorded or live: the newest one at a time, and its pixels."""

from dataclasses import dataclass
from typing import Protocol

from app.geometry import FloatArray, ImageSample


@dataclass(frozen=True, slots=True, eq=False)
class ImagePose:
    """Where an image is: ``matrix`` (4, 4) maps (column, row, 0) to mm in a frame.

    ``matrix`` is None exactly if ``problem`` is not empty: an image whose place is not known has no
    place at which it could be drawn by mistake.
    """

    matrix: FloatArray | None
    problem: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class CurrentImage:
    """The newest image at a time. It may be shown exactly if ``pose`` has a matrix.

    ``number``: None before the first image. ``depth_mm``: the imaging depth by whose calibration it
    is placed; None for a probe with one.
    """

    number: int | None
    pose: ImagePose
    depth_mm: float | None = None


class ImageSource(Protocol):
    """Images that a page shows. One thread calls it."""

    @property
    def size(self) -> tuple[int, int] | None:
        """Columns and rows of every image, in MF; None before the first one."""

    def at(self, now_ns: int, frame: str) -> CurrentImage:
        """The newest image at ``now_ns`` on the tracker's clock, placed in ``frame``."""

    def image(self, number: int) -> ImageSample:
        """Image ``number``, one that `at` has just named."""
