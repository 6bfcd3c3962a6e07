"""The tumour's surface as reports draw it: few faces, each with the least distance of the tool."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.analysis.coverage import WITHIN_MM, Coverage, spread_faces
from app.geometry import FloatArray, SurfaceMesh

MAX_FACES = 1600
_MAX_SAMPLE = 20_000
_ROUNDS = 4


@dataclass(frozen=True, slots=True, eq=False)
class CoveredSurface:
    """A surface about the tumour's centroid, in the patient's axes (right, anterior, superior).

    ``vertices_mm`` (n, 3) and ``faces`` (m, 3), wound outwards. ``nearest_mm`` (m,): the least
    distance of the tool, infinite beyond the largest of `WITHIN_MM`. ``breaches_mm`` (b, 3): the
    places of the breaches, in the order of time.
    """

    vertices_mm: FloatArray
    faces: NDArray[np.integer]
    nearest_mm: FloatArray
    breaches_mm: FloatArray

    @property
    def corners_mm(self) -> FloatArray:
        """The corners (m, 3, 3) of the faces."""
        return np.asarray(self.vertices_mm[self.faces])

    @property
    def normals(self) -> FloatArray:
        """The outward unit normals (m, 3) of the faces."""
        corners = self.corners_mm
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None])

    @property
    def classes(self) -> NDArray[np.intp]:
        """The first of `WITHIN_MM` that each face (m,) is within; their number beyond the last."""
        return np.searchsorted(WITHIN_MM, self.nearest_mm, side="left")

    @property
    def reach_mm(self) -> float:
        """Distance of the farthest vertex from the centroid."""
        return float(np.linalg.norm(self.vertices_mm, axis=1).max())


def covered_surface(
    tumor: SurfaceMesh,
    coverage: Coverage,
    breaches_mm: Sequence[tuple[float, float, float]] = (),
    ras_from_tumor: FloatArray | None = None,
) -> CoveredSurface:
    """``tumor`` with at most about `MAX_FACES` faces, each with the value of the nearest place of
    ``coverage``.

    ``breaches_mm`` are places in the tumour's frame. Without ``ras_from_tumor`` (3, 3) the tumour's
    axes are taken as right, anterior and superior.
    """
    vertices, faces = _simplified(tumor)
    nearest = _nearest(coverage.places_mm, vertices[faces].mean(axis=1))
    turn = np.eye(3) if ras_from_tumor is None else ras_from_tumor
    centroid = tumor.centroid_mm
    places = np.array(breaches_mm, dtype=np.float64).reshape(-1, 3)
    return CoveredSurface(
        (vertices - centroid) @ turn.T,
        faces,
        coverage.nearest_mm[nearest],
        (places - centroid) @ turn.T,
    )


def _simplified(tumor: SurfaceMesh) -> tuple[FloatArray, NDArray[np.integer]]:
    """Vertices (n, 3) and faces (m, 3) of a mesh like ``tumor`` with about `MAX_FACES` at most.

    The vertices are grouped around means that are spread over the surface, and each group becomes
    its mean: the faces have similar sizes. A closed surface stays closed.
    """
    vertices = tumor.vertices_mm
    if len(tumor.faces) <= MAX_FACES:
        return vertices, tumor.faces
    groups = MAX_FACES // 2  # a closed surface has about twice as many faces as vertices
    means = vertices[spread_faces(vertices, groups)]
    sample = vertices[spread_faces(vertices, _MAX_SAMPLE)]
    for _ in range(_ROUNDS):
        means = _means(sample, _nearest(means, sample), means)
    group = _nearest(means, vertices)
    return _means(vertices, group, means), _without_collapsed(group[tumor.faces])


def _nearest(points: FloatArray, places: FloatArray) -> NDArray[np.intp]:
    """Index of the nearest of ``points`` (n, 3) to each of ``places`` (m, 3)."""
    from scipy.spatial import cKDTree  # slow to load

    return np.asarray(cKDTree(points).query(places)[1], dtype=np.intp)


def _means(points: FloatArray, group: NDArray[np.intp], means: FloatArray) -> FloatArray:
    """The mean (g, 3) of each group of ``points`` (n, 3); of an empty one that of ``means``."""
    count = np.bincount(group, minlength=len(means))
    sums = np.stack([np.bincount(group, points[:, k], len(means)) for k in range(3)], axis=1)
    return np.where(count[:, None] > 0, sums / np.maximum(count, 1)[:, None], means)


def _without_collapsed(faces: NDArray[np.intp]) -> NDArray[np.intp]:
    """``faces`` (m, 3) with three different vertices, each once; opposite ones cancel."""
    first = faces.argmin(axis=1)[:, None]
    turned = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    turned = turned[(turned[:, 1] != turned[:, 2]) & (turned[:, 0] < turned[:, 1:].min(axis=1))]
    flipped = turned[:, 1] > turned[:, 2]
    pairs = np.where(flipped[:, None], turned[:, [0, 2, 1]], turned)
    unique, index = np.unique(pairs, axis=0, return_inverse=True)
    net = np.bincount(index.reshape(-1), np.where(flipped, -1.0, 1.0), len(unique))
    return np.concatenate([unique[net > 0.0], unique[net < 0.0][:, [0, 2, 1]]])
