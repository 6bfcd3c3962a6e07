"""Measured transforms and images with their time and status, and the calibration of a probe."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.geometry.errors import FrameError, InputError, TransformError
from app.geometry.frames import check_frame
from app.geometry.stamp import Stamp, slot_setters
from app.geometry.transform import FloatArray, Transform

Pixels = NDArray[np.integer[Any]]
"""(rows, columns) of one value, or (rows, columns, 3) of red, green and blue."""

PIXEL_TYPES = ("uint8", "int8", "uint16", "int16")
MAX_IMAGE_SIDE = 8192
"""Largest number of rows or columns."""


class ImageStatus(IntEnum):
    """Status of one image. Only an `OK` image may be shown as a current one."""

    OK = 0
    INVALID = 1
    """The recorder or the sender marks it as not valid."""
    NO_PIXELS = 2


@dataclass(frozen=True, slots=True, eq=False)
class ImageSample:
    """Image ``number`` of a sequence or a stream, acquired at ``stamp``.

    ``pixels`` is read-only, in the orientation MF: columns towards the marked side of the probe,
    rows away from it. It is None exactly if ``status`` is not `ImageStatus.OK`: an invalid image
    has no pixels that could be shown by mistake. ``stamp`` is None where the source states no time.
    ``pixel_mm``: width and height of a pixel, where the message of the image states them. Raises
    `InputError` for pixels of another shape or type.
    """

    number: int
    stamp: Stamp | None
    status: ImageStatus
    pixels: Pixels | None
    pixel_mm: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if (self.pixels is not None) != (self.status is ImageStatus.OK):
            raise InputError(
                f"image {self.number} with status {self.status.name} "
                f"{'has' if self.pixels is not None else 'lacks its'} pixels; expected pixels for "
                "status OK only"
            )
        if self.pixels is None:
            return
        shape = self.pixels.shape
        if (
            self.pixels.dtype.name not in PIXEL_TYPES
            or (len(shape) != 2 and shape[2:] != (3,))
            or not all(1 <= side <= MAX_IMAGE_SIDE for side in shape[:2])
        ):
            raise InputError(
                f"image {self.number} has pixels of type {self.pixels.dtype} and shape {shape}; "
                f"expected (rows, columns) or (rows, columns, 3) of {', '.join(PIXEL_TYPES)}, "
                f"1 to {MAX_IMAGE_SIDE} on each side"
            )
        self.pixels.flags.writeable = False

    @property
    def size(self) -> tuple[int, int] | None:
        """Columns and rows."""
        return None if self.pixels is None else (self.pixels.shape[1], self.pixels.shape[0])


_MIN_PIXEL_MM, _MAX_PIXEL_MM = 1e-3, 10.0
_MAX_SHEAR_DEG = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class ImageCalibration:
    """``probe_from_image``: what PLUS calls ``ImageToProbe``.

    ``matrix`` (4, 4) is affine, not rigid: it maps (column, row, 0) of the centre of a pixel, in
    the orientation MF, to mm in the frame ``probe``; the lengths of its first two columns are the
    size of a pixel. Copied and read-only. Raises `InputError` for numbers that are not finite, a
    last row that is not 0 0 0 1, pixels below 0.001 mm or above 10 mm, and axes that are more than
    10 degrees from a right angle.
    """

    probe: str
    matrix: FloatArray
    image: str = "image"

    def __post_init__(self) -> None:
        check_frame(self.probe)
        check_frame(self.image)
        name = f"{self.probe}_from_{self.image}"
        matrix = np.array(self.matrix, dtype=np.float64)
        if matrix.size != 16 or not np.isfinite(matrix).all():
            raise InputError(f"{name} is {matrix.tolist()}; expected 16 finite numbers")
        matrix = matrix.reshape(4, 4)
        if not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), rtol=0.0, atol=1e-9):
            raise InputError(f"{name}: its last row is {matrix[3].tolist()}; expected 0 0 0 1")
        with np.errstate(over="ignore"):
            sides = np.linalg.norm(matrix[:3, :2], axis=0)
        if not (sides.min() >= _MIN_PIXEL_MM and sides.max() <= _MAX_PIXEL_MM):
            raise InputError(
                f"{name}: a pixel measures {sides[0]:.6g} x {sides[1]:.6g} mm; expected "
                f"{_MIN_PIXEL_MM:g} to {_MAX_PIXEL_MM:g} mm"
            )
        cosine = float(matrix[:3, 0] @ matrix[:3, 1] / (sides[0] * sides[1]))
        shear = abs(90.0 - math.degrees(math.acos(max(-1.0, min(1.0, cosine)))))
        if shear > _MAX_SHEAR_DEG:
            raise InputError(
                f"{name}: the axes of the image are {shear:.3g} degrees from a right angle; "
                f"expected at most {_MAX_SHEAR_DEG:g}"
            )
        matrix.flags.writeable = False
        object.__setattr__(self, "matrix", matrix)

    @property
    def pixel_mm(self) -> tuple[float, float]:
        """Width and height of a pixel in mm."""
        width, height = np.linalg.norm(self.matrix[:3, :2], axis=0)
        return float(width), float(height)


def image_corners(matrix: ArrayLike, columns: int, rows: int) -> FloatArray:
    """Return the centres of the four corner pixels, (4, 3), mapped by ``matrix`` (4, 4).

    ``matrix`` maps (column, row, 0) to mm of any frame. Order: first pixel, end of the first row,
    last pixel, start of the last row.
    """
    right, below = float(columns - 1), float(rows - 1)
    pixels = np.array([(0, 0, 0, 1), (right, 0, 0, 1), (right, below, 0, 1), (0, below, 0, 1)])
    found: FloatArray = (pixels @ np.asarray(matrix, dtype=np.float64).T)[:, :3]
    return found


class TrackingStatus(IntEnum):
    """Status of one sample. Only `OK` samples may be used for navigation.

    Values 0 to 5 are reported by the tracker (IGSIO's ``ToolStatus``). The others are set by a
    reader for a sample that the tracker reported as OK.
    """

    OK = 0
    INVALID = 1
    MISSING = 2
    OUT_OF_VIEW = 3
    OUT_OF_VOLUME = 4
    REQUEST_TIMEOUT = 5
    NOT_FINITE = 6
    NOT_RIGID = 7


@dataclass(frozen=True, slots=True, eq=False)
class TrackedTransform:
    """A sample of ``target_from_source``, acquired at ``stamp``.

    ``transform`` is None exactly if ``status`` is not `TrackingStatus.OK`: a lost pose has no
    numbers that could be used by mistake. ``target`` and ``source`` are known in both cases; with
    a transform they default to its frames. Raises `TransformError` if transform and status
    contradict each other, `FrameError` if the frames do.
    """

    transform: Transform | None
    stamp: Stamp
    status: TrackingStatus
    target: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        if (self.transform is not None) != (self.status is TrackingStatus.OK):
            raise TransformError(
                f"a sample with status {self.status.name} "
                f"{'has a' if self.transform is not None else 'lacks its'} transform; "
                "expected one for status OK only"
            )
        if self.transform is None:
            check_frame(self.target)
            check_frame(self.source)
        elif (self.target, self.source) != (self.transform.target, self.transform.source):
            self._set_frames_of(self.transform)

    def _set_frames_of(self, transform: Transform) -> None:
        for name, given, known in (
            ("target", self.target, transform.target),
            ("source", self.source, transform.source),
        ):
            if given not in ("", known):
                raise FrameError(f"{name} {given!r} contradicts the transform; expected {known!r}")
            object.__setattr__(self, name, known)

    @classmethod
    def valid(cls, transform: Transform, stamp: Stamp) -> "TrackedTransform":
        """A sample with status `TrackingStatus.OK` and the frames of its transform, unchecked."""
        made = object.__new__(cls)
        _set_transform(made, transform)
        _set_stamp(made, stamp)
        _set_status(made, TrackingStatus.OK)
        _set_target(made, transform.target)
        _set_source(made, transform.source)
        return made

    @classmethod
    def lost(
        cls, target: str, source: str, stamp: Stamp, status: TrackingStatus
    ) -> "TrackedTransform":
        """A sample without a transform: the pose of ``source`` in ``target`` is not known."""
        return cls(None, stamp, status, target, source)


_set_transform, _set_stamp, _set_status, _set_target, _set_source = slot_setters(TrackedTransform)
