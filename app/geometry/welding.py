"""Corners at the same place as one: files of triangles repeat them in every face."""

import numpy as np
from numpy.typing import NDArray

from app.geometry.transform import FloatArray


def welded(
    vertices: FloatArray, faces: NDArray[np.integer]
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.bool_]]:
    """Each of ``vertices`` (n, 3) once, sorted by x, then y, then z, and ``faces`` (m, 3) of them.

    Vertices are finite. Faces that lose a corner are dropped; the third array, (m,), tells which
    were kept.
    """
    # Sorted column by column: several times faster than `np.unique` with an axis.
    order = np.lexsort(vertices.T[::-1])
    ordered = vertices[order]
    is_new = np.ones(len(ordered), dtype=np.bool_)
    is_new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    index = np.empty(len(ordered), dtype=np.int64)
    index[order] = np.cumsum(is_new) - 1
    merged = index[faces]
    first, second, third = merged.T
    kept = (first != second) & (second != third) & (third != first)
    return ordered[is_new], merged[kept], kept
