"""A triangle surface in a named frame, in mm."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from app.geometry.errors import FrameError, MeshError
from app.geometry.frames import check_frame
from app.geometry.transform import FloatArray, Transform

IntArray = NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceMesh:
    """Vertices (n, 3) in mm in ``frame``, and faces (m, 3) of vertex indices, normals outward.

    Both arrays are copied and read-only. Raises `MeshError` for an empty mesh, non-finite vertices
    and face indices out of range.

    >>> import marginguard as mg
    >>> corners = [[0, 0, 0], [6, 0, 0], [0, 6, 0], [0, 0, 6]]
    >>> mesh = mg.SurfaceMesh("tumor", corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> mesh.open_edges(), round(mesh.signed_volume_mm3)
    (0, 36)
    """

    frame: str
    vertices_mm: FloatArray
    faces: IntArray

    def __post_init__(self) -> None:
        check_frame(self.frame)
        vertices = np.array(self.vertices_mm, dtype=np.float64)
        faces = np.array(self.faces)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) == 0:
            raise MeshError(
                f"vertices of the mesh in {self.frame!r} have shape {vertices.shape}; "
                "expected (n, 3) with n > 0"
            )
        if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
            raise MeshError(
                f"faces of the mesh in {self.frame!r} have shape {faces.shape}; "
                "expected (m, 3) with m > 0"
            )
        finite = np.isfinite(vertices).all(axis=1)
        if not finite.all():
            first = int(np.argmin(finite))
            raise MeshError(
                f"vertex {first} of the mesh in {self.frame!r} is {vertices[first].tolist()}; "
                f"expected finite numbers ({int((~finite).sum())} of {len(vertices)} are not)"
            )
        if faces.dtype.kind not in "iu" or faces.min() < 0 or faces.max() >= len(vertices):
            raise MeshError(
                f"faces of the mesh in {self.frame!r} span {faces.min()} to {faces.max()}; "
                f"expected integers from 0 to {len(vertices) - 1}"
            )
        faces = faces.astype(np.int32)
        vertices.flags.writeable = False
        faces.flags.writeable = False
        object.__setattr__(self, "vertices_mm", vertices)
        object.__setattr__(self, "faces", faces)

    @property
    def triangles_mm(self) -> FloatArray:
        """Corners of each face, (m, 3, 3), in mm."""
        return self.vertices_mm[self.faces]

    @property
    def bounds_mm(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest corner, (3,) each in mm, of the axis-aligned bounding box."""
        return self.vertices_mm.min(axis=0), self.vertices_mm.max(axis=0)

    @property
    def box_corners_mm(self) -> FloatArray:
        """Corners of the axis-aligned bounding box, (8, 3) in mm."""
        return np.array(list(product(*zip(*self.bounds_mm, strict=True))))

    @property
    def signed_volume_mm3(self) -> float:
        """Enclosed volume; negative if the normals of a closed mesh point inward."""
        # Relative to the centroid: coordinates far from the origin would lose digits.
        first, second, third = np.moveaxis(self.triangles_mm - self.vertices_mm.mean(axis=0), 1, 0)
        return float(np.einsum("ij,ij->", first, np.cross(second, third))) / 6.0

    @property
    def centroid_mm(self) -> FloatArray:
        """Centre of the area, (3,) in mm; it does not depend on how fine the triangles are."""
        corners = self.triangles_mm
        areas = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        total = float(areas.sum())
        if total <= 0.0:
            return np.asarray(self.vertices_mm.mean(axis=0))
        return np.asarray(areas @ corners.mean(axis=1) / total)

    def open_edges(self) -> int:
        """Number of directed edges without an opposite edge: 0 for a closed, oriented surface."""
        edges = np.concatenate(
            [self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]]
        )
        start, end = edges.astype(np.int64).T
        count = len(self.vertices_mm)
        forward, reverse = np.sort(start * count + end), np.sort(end * count + start)
        if np.array_equal(forward, reverse):
            return 0
        _, edge_of = np.unique(np.concatenate([forward, reverse]), return_inverse=True)
        signs = np.repeat([1.0, -1.0], len(edges))
        return int(np.abs(np.bincount(edge_of, weights=signs)).sum()) // 2

    def require_closed(self, what: str) -> "SurfaceMesh":
        """Return self if closed with outward normals; else raise `MeshError` naming ``what``."""
        unmatched = self.open_edges()
        if unmatched:
            raise MeshError(
                f"{what} is not closed: {unmatched} edges have no neighbouring face; expected 0"
            )
        volume = self.signed_volume_mm3
        if volume <= 0.0:
            raise MeshError(
                f"{what} encloses {volume:.6g} mm3; expected a positive volume (outward normals)"
            )
        return self

    def transformed(self, target_from_frame: Transform) -> "SurfaceMesh":
        """Return the same surface in another frame.

        Raises `FrameError` for a transform that is not from the frame of the mesh.
        """
        if target_from_frame.source != self.frame:
            raise FrameError(
                f"a mesh in {self.frame!r} cannot be transformed by "
                f"{target_from_frame.target}_from_{target_from_frame.source}; "
                f"expected a transform from {self.frame!r}"
            )
        return SurfaceMesh(
            target_from_frame.target, target_from_frame.apply(self.vertices_mm), self.faces
        )


def distinct_rows(
    rows: FloatArray,
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """The distinct ``rows`` (n, 3), which must be finite, sorted by x, then y, then z: (k, 3).

    Also returns the first place of each (k,), and the number of each of ``rows`` (n,) among them.
    """
    # `np.lexsort` is several times faster than `np.unique` with an axis.
    order = np.lexsort(rows.T[::-1])
    # `take` and `compress` release the GIL, indexing by an array does not.
    ordered = np.take(rows, order, axis=0)
    is_new = np.ones(len(ordered), dtype=np.bool_)
    is_new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    number = np.empty(len(ordered), dtype=np.int64)
    number[order] = np.cumsum(is_new) - 1
    return np.compress(is_new, ordered, axis=0), np.compress(is_new, order), number


def weld_vertices(
    vertices: FloatArray, faces: NDArray[np.integer]
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.bool_]]:
    """Merge equal ``vertices`` (n, 3), which must be finite, and reindex ``faces`` (m, 3).

    Returns the vertices of `distinct_rows`, the faces with three distinct corners, and the mask
    (m,) of these faces.
    """
    distinct, _, number = distinct_rows(vertices)
    merged = np.take(number, faces)
    first, second, third = merged.T
    kept = (first != second) & (second != third) & (third != first)
    if not kept.all():
        merged = np.compress(kept, merged, axis=0)
    return distinct, merged, kept
