"""Points that the surface of marked voxels must contain, by a search voxel by voxel.

Independent of `app.case.tumor.surfaces`, which finds thin voxels by binary morphology on whole
arrays. The rules are those of its documentation: the surface crosses the line to a neighbour at 0.2
voxels or more, and at 0.5 or more from a voxel that no cross of seven marked voxels contains.
"""

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray


def contained_points_mm(marked: NDArray[np.bool_], frame_from_index: FloatArray) -> FloatArray:
    """Points (n, 3), just inside those distances, for the true voxels of ``marked`` (i, j, k)."""
    padded = np.pad(marked, 2)
    cross = [np.zeros(3, dtype=int), *np.eye(3, dtype=int), *-np.eye(3, dtype=int)]
    voxels = np.argwhere(padded)
    centres = [
        tuple(voxel) for voxel in voxels if all(padded[tuple(voxel + step)] for step in cross)
    ]
    thick = {tuple(np.add(centre, step)) for centre in centres for step in cross}
    reach = np.where([tuple(voxel) in thick for voxel in voxels], 0.199, 0.499)
    points = np.concatenate([voxels + reach[:, None] * step for step in cross]) - 2.0
    return points @ frame_from_index[:, :3].T + frame_from_index[:, 3]
