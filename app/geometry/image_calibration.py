"""The calibration of an ultrasound probe: from pixels of its image to the frame of its sensor."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from app.geometry.errors import InputError
from app.geometry.frames import check_frame
from app.geometry.transform import FloatArray

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
