"""Independent oracle of signed proximity: libigl's winding number and distances, and FCL.

It is independent of `app.fixture`: it uses none of its code.
"""

from dataclasses import dataclass
from enum import Enum

import fcl
import igl
import numpy as np

from app.geometry import FloatArray, SurfaceMesh, Transform
from benchmarks.fixture.engines import fcl_object


class Relation(Enum):
    """The relation of a tool and a tumour, in the order of the tests."""

    MEETING = "surfaces meet"
    TOOL_INSIDE = "tool in tumour"
    TUMOR_INSIDE = "tumour in tool"
    APART = "apart"


class _Solid:
    """A closed mesh for point queries, with the data structures of libigl."""

    def __init__(self, mesh: SurfaceMesh) -> None:
        self._vertices = np.array(mesh.vertices_mm)
        self._faces = mesh.faces.astype(np.int64)
        self._low, self._high = self._vertices.min(axis=0), self._vertices.max(axis=0)
        self._tree, self._winding = igl.AABB(), igl.FastWindingNumberBVH()
        self._tree.init(self._vertices, self._faces)
        self._winding.init(self._vertices, self._faces)

    def contains_any(self, points_mm: FloatArray) -> bool:
        """True if any of a few points (n, 3) is inside, by the exact winding number."""
        boxed = ((points_mm >= self._low) & (points_mm <= self._high)).all(axis=1)
        if not boxed.any():
            return False
        points = np.ascontiguousarray(points_mm[boxed])
        winding = igl.winding_number(self._vertices, self._faces, points)
        return bool((np.atleast_1d(winding) > 0.5).any())

    def signed(self, points_mm: FloatArray) -> FloatArray:
        """The signed distances (n,) of points (n, 3), negative inside."""
        points = np.ascontiguousarray(points_mm)
        squared, _, _ = self._tree.squared_distance(self._vertices, self._faces, points)
        inside = self._winding.winding_number(points) > 0.5
        return np.where(inside, -1.0, 1.0) * np.sqrt(squared)


@dataclass(frozen=True, eq=False)
class Oracle:
    """Oracle for a tumour and a tool, with a point of each part and the tool's faces (n, 3, 3)."""

    tumor_points_mm: FloatArray
    tool_points_mm: FloatArray
    tool_faces_mm: FloatArray
    _solids: tuple[_Solid, _Solid]
    _objects: tuple[fcl.CollisionObject, fcl.CollisionObject]

    @classmethod
    def of(cls, tumor: SurfaceMesh, tool: SurfaceMesh) -> "Oracle":
        """Build the data structures of libigl and FCL for both meshes."""
        return cls(
            _part_points(tumor),
            _part_points(tool),
            tool.vertices_mm[tool.faces],
            (_Solid(tumor), _Solid(tool)),
            tuple(fcl_object(mesh.vertices_mm, mesh.faces) for mesh in (tumor, tool)),
        )

    def touches(self, tumor_from_tool: Transform) -> bool:
        """True if the surfaces intersect, by FCL."""
        self._objects[1].setTransform(
            fcl.Transform(tumor_from_tool.rotation, tumor_from_tool.translation_mm)
        )
        return touches(*self._objects)

    def relation(self, tumor_from_tool: Transform) -> Relation:
        """Whether the surfaces intersect, a part of one is inside the other, or neither."""
        if self.touches(tumor_from_tool):
            return Relation.MEETING
        if self._solids[0].contains_any(tumor_from_tool.apply(self.tool_points_mm)):
            return Relation.TOOL_INSIDE
        return (
            Relation.TUMOR_INSIDE if self.tool_contains_tumor(tumor_from_tool) else Relation.APART
        )

    def overlaps(self, tumor_from_tool: Transform) -> bool:
        """True if tool and tumour share a point."""
        return self.relation(tumor_from_tool) is not Relation.APART

    def tool_contains_tumor(self, tumor_from_tool: Transform) -> bool:
        """True if a point of some part of the tumour is inside the tool."""
        tool_from_tumor = tumor_from_tool.inverse()
        return self._solids[1].contains_any(tool_from_tumor.apply(self.tumor_points_mm))

    def signed_distance_mm(self, tumor_from_tool: Transform, resolution_mm: float = 0.04) -> float:
        """The minimum signed distance over samples of the tool's surface.

        Never below the true minimum, and above it by at most ``resolution_mm``: a face is bisected
        and sampled at its centroid as long as it may contain a point that is lower by that than the
        lowest sample. The bound of a face follows from the distance's Lipschitz constant of 1.
        """
        tumor = self._solids[0]
        faces = tumor_from_tool.apply(self.tool_faces_mm.reshape(-1, 3)).reshape(-1, 3, 3)
        lowest = float(tumor.signed(faces.reshape(-1, 3)).min())
        while len(faces):
            middles = faces.mean(axis=1)
            reach = np.linalg.norm(faces - middles[:, None], axis=2).max(axis=1)
            distances = tumor.signed(middles)
            lowest = min(lowest, float(distances.min()))
            faces = _bisected(faces[distances - reach < lowest - resolution_mm])
        return lowest


def random_pose(
    rng: np.random.Generator, spread_mm: float, target: str = "tumor", source: str = "tool"
) -> Transform:
    """A random rotation, and a normally distributed translation with this sigma on each axis."""
    quaternion = rng.normal(size=4)
    return Transform.from_quaternion(
        quaternion / np.linalg.norm(quaternion),
        rng.normal(scale=spread_mm, size=3),
        target=target,
        source=source,
    )


def _bisected(faces: FloatArray) -> FloatArray:
    """The triangles (n, 3, 3) bisected at their longest sides, (2 n, 3, 3).

    That makes the slender triangles of tools compact.
    """
    sides = np.linalg.norm(np.roll(faces, -1, axis=1) - faces, axis=2)
    turn = (sides.argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, turn[:, :, None], axis=1).transpose(1, 0, 2)
    halfway = 0.5 * (a + b)
    return np.concatenate([np.stack([a, halfway, c], axis=1), np.stack([halfway, b, c], axis=1)])


def _part_points(mesh: SurfaceMesh) -> FloatArray:
    _, label = igl.facet_components(mesh.faces.astype(np.int64))
    _, first = np.unique(label, return_index=True)
    return mesh.vertices_mm[mesh.faces[first, 0]]


def touches(first: fcl.CollisionObject, second: fcl.CollisionObject) -> bool:
    """True if two surfaces intersect, by FCL."""
    request, result = fcl.CollisionRequest(num_max_contacts=1), fcl.CollisionResult()
    return bool(fcl.collide(first, second, request, result))
