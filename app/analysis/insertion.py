"""Metrics of a needle's insertion by the definitions of Perk Tutor.

Perk Tutor (Ungi et al. 2012) sums the measured positions of the tip as they are, without smoothing,
and counts a step to the tissue if the tip is inside the tissue's model at its end, wherever the
rest of the tool is. Gaps are not left out: a step across a loss of the tracker counts with its
whole time and length.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.analysis.samples import CaseSamples
from app.fixture.surfaces.bvh import indexed_bvh
from app.fixture.surfaces.winding_number import dipoles_of, winding_numbers
from app.geometry import FloatArray, InputError, SurfaceMesh

_BLOCK = 64
_PAIRS = 2_000_000
"""Pairs of a ray and a sphere, or of a ray and a face, at a time: bounds the memory."""
_EDGE = 1e-9
"""Barycentric tolerance: a ray through an edge crosses at least one of its faces."""
FORWARD = (0.0, 0.0, 1.0)
"""The needle's axis in the frame of its tip, by the convention of a case: +z forward."""


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

    Faces are grouped in blocks of neighbours with a bounding sphere. A ray is tested against the
    spheres first, so that a surface of many faces costs little more than one of few.

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


def tissue_damage_mm2(
    tips_mm: FloatArray, rotations: FloatArray, in_tissue: NDArray[np.bool_], tissue: SurfaceMesh
) -> float:
    """The area in mm2 that the needle sweeps in ``tissue``, a closed surface, as in Perk Tutor.

    Between two frames with the tip in the tissue, the needle sweeps the quadrilateral of both tips
    and both entry points: where the needle's axis, from the tip backwards, first leaves the tissue.
    Its area is that of two triangles. A needle that moves along its axis sweeps nothing.

    ``tips_mm`` (n, 3) and ``rotations`` (n, 3, 3) are its poses in the frame of ``tissue``, in the
    order of time. Frames outside of ``in_tissue`` (n,) do not count, nor those whose tip is outside
    although another part of the tool is in the tissue.
    """
    frames = np.flatnonzero(in_tissue)
    tips = tips_mm[frames]
    backward = -rotations[frames] @ np.array(FORWARD)
    found = first_crossings(tissue, tips, backward)
    inside = found.leaves & np.isfinite(found.distances_mm)
    pairs = np.flatnonzero(inside[1:] & inside[:-1] & (np.diff(frames) == 1))
    with np.errstate(invalid="ignore"):
        entries = tips + found.distances_mm[:, None] * backward
    before, after = tips[pairs], tips[pairs + 1]
    entry_before, entry_after = entries[pairs], entries[pairs + 1]
    areas = _areas(before, after, entry_after) + _areas(entry_after, entry_before, before)
    return float(areas.sum())


def _areas(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Areas (n,) of triangles with these corners (n, 3)."""
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


@dataclass(frozen=True, slots=True)
class Insertion:
    """Times in s, lengths in mm, from the first to the last known tip.

    ``tissue_s`` and ``tissue_path_mm``: of the steps that end with the tip in the tissue.
    ``tissue_damage_mm2``: the area of `tissue_damage_mm2`, None where it was not asked for.
    """

    elapsed_s: float
    path_mm: float
    tissue_s: float
    tissue_path_mm: float
    tissue_damage_mm2: float | None = None


def case_insertion(samples: CaseSamples, tumor: SurfaceMesh) -> Insertion:
    """The metrics of a case, whose tissue is the surface ``tumor``, with the tissue damage.

    Frames without a distance are left out: their pose is not known to be good.
    """
    known = np.isfinite(samples.distances_mm)
    return insertion_metrics(
        samples.times_s[known],
        samples.tips_mm[known],
        tumor,
        rotations=samples.rotations[known],
    )


def insertion_metrics(
    times_s: FloatArray,
    tips_mm: FloatArray,
    tissue: SurfaceMesh,
    *,
    rotations: FloatArray | None = None,
) -> Insertion:
    """The metrics of the tips (n, 3) at ``times_s`` (n,), in the frame of the closed ``tissue``.

    Frames with a NaN and those whose times do not increase are left out. ``rotations`` (n, 3, 3) of
    the tool add the tissue damage. Raises `InputError` for other shapes.
    """
    if tips_mm.shape != (len(times_s), 3):
        raise InputError(
            f"insertion: times have shape {times_s.shape} and tips {tips_mm.shape}; "
            "expected (n,) and (n, 3)"
        )
    if rotations is not None and rotations.shape != (len(times_s), 3, 3):
        raise InputError(
            f"insertion: rotations have shape {rotations.shape}; expected {(len(times_s), 3, 3)}"
        )
    frames = np.flatnonzero(np.isfinite(tips_mm).all(axis=1))
    highest = np.append(-np.inf, np.maximum.accumulate(times_s[frames])[:-1])
    frames = frames[times_s[frames] > highest[: len(frames)]]
    times, tips = times_s[frames], tips_mm[frames]
    inside = tips_inside(tips, tissue)
    damage = None
    if rotations is not None:
        damage = tissue_damage_mm2(tips, rotations[frames], inside, tissue)
    seconds, lengths = np.diff(times), np.linalg.norm(np.diff(tips, axis=0), axis=1)
    return Insertion(
        float(seconds.sum()),
        float(lengths.sum()),
        float(seconds[inside[1:]].sum()),
        float(lengths[inside[1:]].sum()),
        damage,
    )


def tips_inside(tips_mm: FloatArray, tissue: SurfaceMesh) -> NDArray[np.bool_]:
    """True for each of ``tips_mm`` (n, 3) that is inside the closed ``tissue``."""
    low, high = tissue.bounds_mm
    near = np.flatnonzero(((tips_mm >= low) & (tips_mm <= high)).all(axis=1))
    inside = np.zeros(len(tips_mm), dtype=bool)
    if len(near):
        dipoles = dipoles_of(indexed_bvh(tissue.vertices_mm, tissue.faces))
        inside[near] = winding_numbers(dipoles, tips_mm[near]) > 0
    return inside
