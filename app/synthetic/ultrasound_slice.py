"""Images of a simulated probe: a plane through tissue with a tumour, with speckle."""

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, Transform
from app.synthetic.tumour import Tumour

COLUMNS, ROWS = 200, 160
PIXEL_MM = 0.25

_TUMOUR_LEVEL, _TISSUE_LEVEL, _SPECKLE = 45.0, 130.0, 0.8


def probe_from_image() -> FloatArray:
    """ImageToProbe (4, 4): pixels to mm, the middle of the image at the origin of the probe."""
    matrix = np.diag([PIXEL_MM, PIXEL_MM, PIXEL_MM, 1.0])
    matrix[:2, 3] = -PIXEL_MM * COLUMNS / 2, -PIXEL_MM * ROWS / 2
    return matrix


class UltrasoundSlice:
    """Images of ``tumour``, which is darker than the tissue around it. For one thread.

    The tissue is computed anew for another pose of the probe; the speckle differs in each image.
    """

    def __init__(self, tumour: Tumour, random: np.random.Generator) -> None:
        self._tumour, self._random = tumour, random
        row, column = np.mgrid[:ROWS, :COLUMNS]
        pixels = np.stack([column, row, np.zeros_like(row), np.ones_like(row)], axis=-1)
        self._probe_mm = (pixels.reshape(-1, 4) @ probe_from_image().T)[:, :3]
        self._pose: FloatArray | None = None
        self._level = np.zeros((ROWS, COLUMNS))

    def image(self, tumor_from_probe: Transform) -> NDArray[np.uint8]:
        """The image (rows, columns) at this pose."""
        matrix = tumor_from_probe.matrix
        if self._pose is None or not np.array_equal(matrix, self._pose):
            places_mm = tumor_from_probe.apply(self._probe_mm) + 1e-9  # no direction is zero
            radius_mm = np.linalg.norm(places_mm, axis=1)
            inside = radius_mm < self._tumour.radius_mm(places_mm / radius_mm[:, None])
            level = np.where(inside, _TUMOUR_LEVEL, _TISSUE_LEVEL)
            self._pose, self._level = matrix, level.reshape(ROWS, COLUMNS)
        speckle = self._random.rayleigh(_SPECKLE, size=self._level.shape)
        return np.clip(self._level * speckle, 0, 255).astype(np.uint8)
