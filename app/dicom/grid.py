"""The grid of voxels that encloses a set of surfaces, in LPS as DICOM has it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.dicom.contours import contours_at, pixels_inside
from app.geometry import FloatArray, InputError, SurfaceMesh

MAX_VOXELS = 64_000_000
_BORDER = 2
"""Empty voxels around the surfaces."""
_PHASE = 0.3125
"""Share of a voxel by which centres are off its multiples: flat faces are often at multiples, where
rounding would decide whether a layer of voxels is inside."""


@dataclass(frozen=True, slots=True)
class VoxelGrid:
    """Centre of the first voxel (3,) in mm, number of voxels along x, y, z, edge of a voxel in mm.

    Columns run along x (left), rows along y (posterior), slices along z (superior).
    """

    origin_mm: tuple[float, float, float]
    shape: tuple[int, int, int]
    voxel_mm: float

    @classmethod
    def around(cls, surfaces: Sequence[SurfaceMesh], voxel_mm: float) -> "VoxelGrid":
        """The grid around ``surfaces``, aligned to multiples of ``voxel_mm`` and a fixed share.

        Raises `InputError` for more than `MAX_VOXELS` voxels.
        """
        low = np.min([surface.bounds_mm[0] for surface in surfaces], axis=0)
        high = np.max([surface.bounds_mm[1] for surface in surfaces], axis=0)
        first = np.floor(low / voxel_mm) - _BORDER + _PHASE
        shape = np.ceil(high / voxel_mm - first) + _BORDER + 1
        if shape.prod() > MAX_VOXELS:
            size = " x ".join(f"{length:.0f}" for length in high - low)
            raise InputError(
                f"voxels of {voxel_mm:g} mm: {shape.prod():.3g} of them enclose {size} mm; "
                f"expected {MAX_VOXELS} at most: larger voxels"
            )
        x, y, z = (first * voxel_mm).tolist()
        columns, rows, slices = (int(number) for number in shape)
        return cls((x, y, z), (columns, rows, slices), voxel_mm)

    def axis_mm(self, axis: int) -> FloatArray:
        """Centres of the voxels along ``axis`` (0: x), in mm."""
        return np.asarray(self.origin_mm[axis] + self.voxel_mm * np.arange(self.shape[axis]))

    def contours(self, surface: SurfaceMesh) -> tuple[tuple[FloatArray, ...], ...]:
        """Contours of ``surface`` in the plane of each slice, (n, 2) each in mm."""
        return tuple(contours_at(surface, height) for height in self.axis_mm(2).tolist())

    def voxels(self, contours: Sequence[tuple[FloatArray, ...]]) -> NDArray[np.bool_]:
        """Voxels (slices, rows, columns) whose centre is inside ``contours``, by slice."""
        xs, ys = self.axis_mm(0), self.axis_mm(1)
        return np.stack([pixels_inside(each, xs, ys) for each in contours])
