"""One acquired image, with its time and its status."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.geometry.errors import InputError
from app.geometry.stamp import Stamp

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
