"""Contours of closed surfaces in parallel planes, the pixels inside them, and their grid of voxels.

The loops follow the connectivity of the triangles: nothing is joined by rounded coordinates, so
every contour of a closed surface is closed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, InputError, SurfaceMesh

_MIN_AREA_MM2 = 1e-6
MAX_VOXELS = 64_000_000
_BORDER = 2
"""Empty voxels around the surfaces."""
_PHASE = 0.3125
"""Share of a voxel by which centres are off its multiples: flat faces are often at multiples, where
rounding would decide whether a layer of voxels is inside."""


def contours_at(surface: SurfaceMesh, height_mm: float) -> tuple[FloatArray, ...]:
    """Closed contours, (n, 2) each in mm, of ``surface`` in the plane z = ``height_mm``.

    The last point is not the first one. Outer contours are counter-clockwise seen from +z, those of
    holes clockwise. A vertex in the plane counts as above it. ``surface`` is closed with outward
    normals (`SurfaceMesh.require_closed`).
    """
    above = surface.vertices_mm[:, 2] >= height_mm
    corners_above = above[surface.faces]
    crossing = corners_above.any(axis=1) & ~corners_above.all(axis=1)
    faces = surface.faces[crossing].astype(np.int64)
    if not len(faces):
        return ()
    starts, ends = faces, np.roll(faces, -1, axis=1)
    # One edge of each face leads down through the plane and one up.
    down = (above[starts] & ~above[ends]).argmax(axis=1)
    up = (~above[starts] & above[ends]).argmax(axis=1)
    rows = np.arange(len(faces))
    count = len(surface.vertices_mm)
    upper, lower = starts[rows, down], ends[rows, down]
    first = upper * count + lower
    last = ends[rows, up] * count + starts[rows, up]
    following = np.empty(len(faces), dtype=np.int64)
    following[np.argsort(last, kind="stable")] = np.argsort(first, kind="stable")
    points = _crossings(surface.vertices_mm, upper, lower, height_mm)
    return tuple(
        loop
        for order in _cycles(following)
        if (loop := _without_repeats(points[order])) is not None
    )


def signed_area_mm2(contour: FloatArray) -> float:
    """Area enclosed by ``contour`` (n, 2), negative where it is clockwise."""
    x, y = (contour - contour[0]).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0


def with_keyholes(contours: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    """Outer ``contours`` with their holes joined to them by channels without width.

    A reader of DICOM then needs no rule for contours within contours (PS3.3, C.8.8.6.3).
    """
    outer = [contour for contour in contours if signed_area_mm2(contour) > 0.0]
    holes: list[list[FloatArray]] = [[] for _ in outer]
    for hole in contours:
        if signed_area_mm2(hole) > 0.0:
            continue
        x, y = hole[:1, 0], hole[:1, 1]
        around = [k for k, each in enumerate(outer) if pixels_inside((each,), x, y)[0, 0]]
        if around:
            holes[min(around, key=lambda k: signed_area_mm2(outer[k]))].append(hole)
    return tuple(_joined(contour, inner) for contour, inner in zip(outer, holes, strict=True))


def pixels_inside(
    contours: tuple[FloatArray, ...], xs_mm: FloatArray, ys_mm: FloatArray
) -> NDArray[np.bool_]:
    """Mask of the pixels, (rows, columns), with their centre in an odd number of ``contours``.

    ``xs_mm`` (columns) and ``ys_mm`` (rows) are evenly spaced and rise.
    """
    toggles = np.zeros((len(ys_mm), len(xs_mm) + 1), dtype=np.int64)
    for contour in contours:
        start, end = contour, np.roll(contour, -1, axis=0)
        low = np.searchsorted(ys_mm, np.minimum(start[:, 1], end[:, 1]))
        high = np.searchsorted(ys_mm, np.maximum(start[:, 1], end[:, 1]))
        number = high - low
        edge = np.repeat(np.arange(len(contour)), number)
        row = np.arange(len(edge)) - np.repeat(np.cumsum(number) - number - low, number)
        share = (ys_mm[row] - start[edge, 1]) / (end[edge, 1] - start[edge, 1])
        x = start[edge, 0] + share * (end[edge, 0] - start[edge, 0])
        np.add.at(toggles, (row, np.searchsorted(xs_mm, x)), 1)
    return np.asarray(np.cumsum(toggles, axis=1)[:, :-1] % 2 == 1)


def _joined(contour: FloatArray, holes: list[FloatArray]) -> FloatArray:
    """``contour`` with ``holes``, the nearest one first: its channel then crosses no other one."""
    left = list(holes)
    if left:
        from scipy.spatial import KDTree  # slow to load
    while left:
        tree = KDTree(contour)
        pairs = [tuple(map(np.asarray, tree.query(hole))) for hole in left]
        nearest = min(range(len(left)), key=lambda k: float(pairs[k][0].min()))
        hole, (distance, index) = left.pop(nearest), pairs[nearest]
        there = int(distance.argmin())
        here = int(index[there])
        loop = np.concatenate([hole[there:], hole[: there + 1]])
        contour = np.concatenate([contour[: here + 1], loop, contour[here:]])
    return contour


def _crossings(
    vertices: FloatArray, upper: NDArray[np.int64], lower: NDArray[np.int64], height_mm: float
) -> FloatArray:
    """Where the edges cross the plane, (n, 2): the same numbers for both faces of an edge."""
    top, bottom = vertices[upper], vertices[lower]
    share = (height_mm - bottom[:, 2]) / (top[:, 2] - bottom[:, 2])
    crossing = bottom + share[:, None] * (top - bottom)
    return np.asarray(crossing[:, :2])


def _cycles(following: NDArray[np.int64]) -> Iterator[list[int]]:
    """The cycles of a permutation, each from its lowest number."""
    left = np.ones(len(following), dtype=bool)
    successor = following.tolist()
    for first in range(len(successor)):
        if not left[first]:
            continue
        cycle, here = [], first
        while left[here]:
            left[here] = False
            cycle.append(here)
            here = successor[here]
        yield cycle


def _without_repeats(points: FloatArray) -> FloatArray | None:
    """``points`` without neighbours at one place; None if they enclose nothing."""
    kept = points[(points != np.roll(points, 1, axis=0)).any(axis=1)]
    if len(kept) < 3 or abs(signed_area_mm2(kept)) < _MIN_AREA_MM2:
        return None
    return np.asarray(kept)


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
