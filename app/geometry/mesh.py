"""A triangle surface in a named frame, in mm."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry.errors import FrameError, MeshError
from app.geometry.frames import check_frame
from app.geometry.transform import FloatArray, Transform

IntArray = NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceMesh:
    """Vertices (n, 3) in mm in ``frame``, and faces (m, 3) of vertex indices, normals outward.

    Both arrays are copied and read-only. Vertices that are not finite, an empty mesh and faces
    that point at no vertex raise `MeshError`.
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
                f"vertices of the mesh in {self.frame!r} have shape {vertices.shape}: "
                "(n, 3) with n > 0 wanted"
            )
        if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
            raise MeshError(
                f"faces of the mesh in {self.frame!r} have shape {faces.shape}: "
                "(m, 3) with m > 0 wanted"
            )
        finite = np.isfinite(vertices).all(axis=1)
        if not finite.all():
            first = int(np.argmin(finite))
            raise MeshError(
                f"vertex {first} of the mesh in {self.frame!r} is {vertices[first].tolist()}: "
                f"finite numbers wanted ({int((~finite).sum())} of {len(vertices)} are not)"
            )
        if faces.dtype.kind not in "iu" or faces.min() < 0 or faces.max() >= len(vertices):
            raise MeshError(
                f"faces of the mesh in {self.frame!r} span {faces.min()} to {faces.max()}: "
                f"whole numbers from 0 to {len(vertices) - 1} wanted"
            )
        faces = faces.astype(np.int32)
        vertices.flags.writeable = False
        faces.flags.writeable = False
        object.__setattr__(self, "vertices_mm", vertices)
        object.__setattr__(self, "faces", faces)

    @property
    def triangles_mm(self) -> FloatArray:
        """The corners of each face, (m, 3, 3)."""
        return self.vertices_mm[self.faces]

    @property
    def bounds_mm(self) -> tuple[FloatArray, FloatArray]:
        """The lowest and the highest corner of the axis-aligned box around the mesh."""
        return self.vertices_mm.min(axis=0), self.vertices_mm.max(axis=0)

    @property
    def signed_volume_mm3(self) -> float:
        """The enclosed volume; negative when the normals of a closed mesh point inward."""
        # Around the centroid, so that a mesh far from the origin does not lose digits.
        first, second, third = np.moveaxis(self.triangles_mm - self.vertices_mm.mean(axis=0), 1, 0)
        return float(np.einsum("ij,ij->", first, np.cross(second, third))) / 6.0

    def open_edges(self) -> int:
        """How many directed edges lack their opposite: 0 for a closed, oriented surface."""
        edges = np.concatenate(
            [self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]]
        )
        start, end = edges.astype(np.int64).T
        count = len(self.vertices_mm)
        there, back = np.sort(start * count + end), np.sort(end * count + start)
        if np.array_equal(there, back):
            return 0
        _, edge_of = np.unique(np.concatenate([there, back]), return_inverse=True)
        signs = np.repeat([1.0, -1.0], len(edges))
        return int(np.abs(np.bincount(edge_of, weights=signs)).sum()) // 2

    def require_closed(self, what: str) -> "SurfaceMesh":
        """Return self when closed with outward normals; raise `MeshError` naming ``what``."""
        unmatched = self.open_edges()
        if unmatched:
            raise MeshError(
                f"{what} is not closed: {unmatched} edges have no neighbouring face, 0 allowed"
            )
        volume = self.signed_volume_mm3
        if volume <= 0.0:
            raise MeshError(
                f"{what} encloses {volume:.6g} mm3: a positive volume (outward normals) wanted"
            )
        return self

    def transformed(self, target_from_frame: Transform) -> "SurfaceMesh":
        """The same surface in another frame."""
        if target_from_frame.source != self.frame:
            raise FrameError(
                f"a mesh in {self.frame!r} cannot be moved by "
                f"{target_from_frame.target}_from_{target_from_frame.source}"
            )
        return SurfaceMesh(
            target_from_frame.target, target_from_frame.apply(self.vertices_mm), self.faces
        )
