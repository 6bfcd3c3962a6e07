"""An independent judge of signed proximity: libigl's winding number and distances, and FCL.

Nothing here uses `app.fixture`. Slow and simple.
"""

from dataclasses import dataclass

import fcl
import igl
import numpy as np
import trimesh
from scipy.spatial import cKDTree

from app.geometry import FloatArray, SurfaceMesh, Transform


@dataclass(frozen=True)
class Oracle:
    """A tumour, a tool, and a dense sample of the tool's surface, its corners included."""

    tumor: SurfaceMesh
    tool: SurfaceMesh
    samples_mm: FloatArray
    coarse_mm: FloatArray
    coarse_of_sample: np.ndarray
    covering_mm: float
    tumor_points_mm: FloatArray
    tool_points_mm: FloatArray
    _objects: tuple[fcl.CollisionObject, fcl.CollisionObject]

    @classmethod
    def of(cls, tumor: SurfaceMesh, tool: SurfaceMesh, samples: int = 20_000) -> "Oracle":
        """Sample the tool at about so many points, its corners and edges included."""
        fine = _samples(tool, samples)
        coarse = _samples(tool, max(10, samples // 100))
        to_coarse, coarse_of_sample = cKDTree(coarse).query(fine)
        return cls(
            tumor,
            tool,
            fine,
            coarse,
            coarse_of_sample,
            float(to_coarse.max()),
            _part_points(tumor),
            _part_points(tool),
            (_collision_object(tumor), _collision_object(tool)),
        )

    def touches(self, tumor_from_tool: Transform) -> bool:
        """Whether the surfaces meet, by FCL."""
        self._objects[1].setTransform(
            fcl.Transform(tumor_from_tool.rotation, tumor_from_tool.translation_mm)
        )
        request, result = fcl.CollisionRequest(num_max_contacts=1), fcl.CollisionResult()
        return bool(fcl.collide(*self._objects, request, result))

    def overlaps(self, tumor_from_tool: Transform) -> bool:
        """Whether tool and tumour share a point: they meet, or a part of one is in the other."""
        if self.touches(tumor_from_tool):
            return True
        moved = tumor_from_tool.apply(self.tool_points_mm)
        return bool(_inside(self.tumor, moved).any()) or self.tool_holds_tumor(tumor_from_tool)

    def tool_holds_tumor(self, tumor_from_tool: Transform) -> bool:
        """Whether a point of some part of the tumour is inside the tool."""
        back = tumor_from_tool.inverse().apply(self.tumor_points_mm)
        return bool(_inside(self.tool, back).any())

    def signed_distance_mm(self, tumor_from_tool: Transform) -> float:
        """The smallest signed distance of the sampled tool: never below the true one.

        The signed distance changes by no more than the way that is gone: a coarse sample tells
        which of the fine samples around it can be lowest.
        """
        coarse = self._signed(tumor_from_tool.apply(self.coarse_mm))
        wanted = coarse <= coarse.min() + self.covering_mm
        fine = np.flatnonzero(wanted[self.coarse_of_sample])
        return float(self._signed(tumor_from_tool.apply(self.samples_mm[fine])).min())

    def _signed(self, points_mm: FloatArray) -> FloatArray:
        vertices, faces = np.asarray(self.tumor.vertices_mm), self.tumor.faces.astype(np.int64)
        points = np.ascontiguousarray(points_mm)
        squared, _, _ = igl.point_mesh_squared_distance(points, vertices, faces)
        inside = igl.fast_winding_number(vertices, faces, points) > 0.5
        return np.where(inside, -1.0, 1.0) * np.sqrt(squared)


def random_pose(
    rng: np.random.Generator, spread_mm: float, target: str = "tumor", source: str = "tool"
) -> Transform:
    """Any rotation, and an origin normally distributed with this spread on each axis."""
    quaternion = rng.normal(size=4)
    return Transform.from_quaternion(
        quaternion / np.linalg.norm(quaternion),
        rng.normal(scale=spread_mm, size=3),
        target=target,
        source=source,
    )


def _inside(mesh: SurfaceMesh, points_mm: FloatArray) -> np.ndarray:
    winding = igl.winding_number(
        np.asarray(mesh.vertices_mm), mesh.faces.astype(np.int64), np.ascontiguousarray(points_mm)
    )
    return np.atleast_1d(winding) > 0.5


def _samples(mesh: SurfaceMesh, count: int) -> FloatArray:
    shape = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
    points, _ = trimesh.sample.sample_surface(shape, count, seed=0)
    start, end = mesh.vertices_mm[shape.edges_unique].transpose(1, 0, 2)
    share = np.linspace(0.0, 1.0, 2 + count // len(start))[1:-1, None, None]
    edges = (start + share * (end - start)).reshape(-1, 3)
    return np.vstack([mesh.vertices_mm, edges, points])


def _part_points(mesh: SurfaceMesh) -> FloatArray:
    _, label = igl.facet_components(mesh.faces.astype(np.int64))
    _, first = np.unique(label, return_index=True)
    return mesh.vertices_mm[mesh.faces[first, 0]]


def _collision_object(mesh: SurfaceMesh) -> fcl.CollisionObject:
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices_mm), len(mesh.faces))
    model.addSubModel(np.array(mesh.vertices_mm), np.array(mesh.faces))
    model.endModel()
    return fcl.CollisionObject(model, fcl.Transform())
