"""Merging of duplicate vertices, which triangle files repeat in every face."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.transform import FloatArray


def weld_vertices(
    vertices: FloatArray, faces: NDArray[np.integer]
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.bool_]]:
    """Merge equal ``vertices`` (n, 3), which must be finite, and reindex ``faces`` (m, 3).

    Returns the distinct vertices (k, 3) sorted by x, then y, then z, the faces with three distinct
    corners, and the mask (m,) of these faces.
    """
    # `np.lexsort` is several times faster than `np.unique` with an axis.
    order = np.lexsort(vertices.T[::-1])
    # `take` and `compress` release the GIL, indexing by an array does not.
    ordered = np.take(vertices, order, axis=0)
    is_new = np.ones(len(ordered), dtype=np.bool_)
    is_new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    index = np.empty(len(ordered), dtype=np.int64)
    index[order] = np.cumsum(is_new) - 1
    merged = np.take(index, faces)
    first, second, third = merged.T
    kept = (first != second) & (second != third) & (third != first)
    if not kept.all():
        merged = np.compress(kept, merged, axis=0)
    return np.compress(is_new, ordered, axis=0), merged, kept
