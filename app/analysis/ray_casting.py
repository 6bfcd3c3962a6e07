"""Where rays first cross a surface, for many rays at once.

Faces are grouped in blocks of neighbours with a bounding sphere. A ray is tested against the
spheres first, so that a surface of many faces costs little more than one of few.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, SurfaceMesh

_BLOCK = 64
_PAIRS = 2_000_000
"""Pairs of a ray and a sphere, or of a ray and a face, at a time: bounds the memory."""
_EDGE = 1e-9
"""Barycentric tolerance: a ray through an edge crosses at least one of its faces."""


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """The first crossing of each ray: ``distances_mm`` (n,), infinite without one.

    ``leaves`` (n,): True where the ray crosses from inside to outside there.
    """

    distances_mm: FloatArray
    leaves: NDArray[np.bool_]


def first_crossings(
    surface: SurfaceMesh, starts_mm: FloatArray, directions: FloatArray
) -> Crossings:
    """The first crossings of rays with ``surface``, whose normals are outward.

    ``starts_mm`` (n, 3) and unit ``directions`` (n, 3) are in the surface's frame. Faces that are
    parallel to a ray are not crossed by it.
    """
    corners = surface.triangles_mm
    blocks, centres, radii = _blocks(corners)
    distances = np.full(len(starts_mm), np.inf)
    leaves = np.zeros(len(starts_mm), dtype=bool)
    at_once = max(1, _PAIRS // len(blocks))
    for first in range(0, len(starts_mm), at_once):
        part = slice(first, first + at_once)
        rays, hit = _near_spheres(starts_mm[part], directions[part], centres, radii)
        pairs = max(1, _PAIRS // _BLOCK)
        for begin in range(0, len(rays), pairs):
            ray = rays[begin : begin + pairs]
            faces = blocks[hit[begin : begin + pairs]]
            crossed, out = _cross(corners, faces, starts_mm[part][ray], directions[part][ray])
            _keep_nearest(distances[part], leaves[part], ray, crossed, out)
    return Crossings(distances, leaves)


def _blocks(corners: FloatArray) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
    """Faces (k, `_BLOCK`) of blocks, the last face repeated, and their spheres (k, 3) and (k,)."""
    from scipy.spatial import cKDTree  # slow to load

    order = cKDTree(corners.mean(axis=1), leafsize=_BLOCK).indices
    padded = np.append(order, np.repeat(order[-1:], -len(order) % _BLOCK))
    blocks = padded.reshape(-1, _BLOCK)
    points = corners[blocks].reshape(len(blocks), -1, 3)
    centres = 0.5 * (points.min(axis=1) + points.max(axis=1))
    radii = np.linalg.norm(points - centres[:, None], axis=2).max(axis=1)
    return blocks, centres, radii * (1.0 + 1e-9) + 1e-9


def _near_spheres(
    starts: FloatArray, directions: FloatArray, centres: FloatArray, radii: FloatArray
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs of a ray and a sphere that it meets."""
    offset = centres[None] - starts[:, None]
    along = np.einsum("nkj,nj->nk", offset, directions)
    square = np.einsum("nkj,nkj->nk", offset, offset)
    aside = square - np.square(along)
    met = (aside <= np.square(radii)) & ((along >= 0.0) | (square <= np.square(radii)))
    rays, hit = np.nonzero(met)
    return rays, hit


def _cross(
    corners: FloatArray, faces: NDArray[np.intp], starts: FloatArray, directions: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The first crossing (p,) of each ray with its ``faces`` (p, b), and whether it leads out.

    By Moeller and Trumbore (1997).
    """
    a, b, c = np.moveaxis(corners[faces], 2, 0)
    one, other, ray = b - a, c - a, directions[:, None]
    across = np.cross(ray, other)
    scale = np.einsum("pbj,pbj->pb", one, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = starts[:, None] - a
        u = np.einsum("pbj,pbj->pb", offset, across) / scale
        turned = np.cross(offset, one)
        v = np.einsum("pbj,pbj->pb", np.broadcast_to(ray, turned.shape), turned) / scale
        t = np.einsum("pbj,pbj->pb", other, turned) / scale
        inside = (u >= -_EDGE) & (v >= -_EDGE) & (u + v <= 1.0 + _EDGE) & (t >= 0.0)
    found = np.where(inside, t, np.inf)
    nearest = found.argmin(axis=1)
    rows = np.arange(len(faces))
    # The determinant is negative where the ray runs along the outward normal.
    return found[rows, nearest], scale[rows, nearest] < 0.0


def _keep_nearest(
    distances: FloatArray,
    leaves: NDArray[np.bool_],
    ray: NDArray[np.intp],
    crossed: FloatArray,
    out: NDArray[np.bool_],
) -> None:
    """Update ``distances`` and ``leaves`` in place by crossings of ``ray``, in rising order."""
    order = np.lexsort((crossed, ray))
    ray, crossed, out = ray[order], crossed[order], out[order]
    first = np.append(True, ray[1:] != ray[:-1])[: len(ray)]
    ray, crossed, out = ray[first], crossed[first], out[first]
    nearer = crossed < distances[ray]
    distances[ray[nearer]], leaves[ray[nearer]] = crossed[nearer], out[nearer]
