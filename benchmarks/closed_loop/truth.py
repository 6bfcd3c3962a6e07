"""True distances and speeds of a tool, from the poses of every physics step."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import igl
import numpy as np

from app.files.paths import shipped
from app.fixture import ProximityEngine
from app.geometry import NS_PER_S, FloatArray, SurfaceMesh, Transform
from app.simulation import open_world
from benchmarks.closed_loop.hand import Phase
from benchmarks.closed_loop.processes import WORLD

SMOOTH = 5  # steps over which a speed is the mean
STILL_MM_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """The tumour and the tool of the world."""

    tumor: SurfaceMesh
    tool: SurfaceMesh

    @classmethod
    def shipped(cls) -> "Surfaces":
        world = open_world(shipped(*WORLD))
        tool = world.robots[0].tool
        assert tool is not None
        return cls(replace(world.tissues[0].mesh, frame="tumor"), replace(tool.mesh, frame="tool"))

    def lowest_vertex_mm(self, tumor_from_tool: Sequence[Transform]) -> float:
        """The smallest signed distance at any pose, of a vertex of one surface to the other.

        By libigl, independent of the product's engine. It is at least the true distance of the
        surfaces.
        """
        tool_from_tumor = [pose.inverse() for pose in tumor_from_tool]
        return min(
            _lowest_vertex_mm(self.tool, self.tumor, tumor_from_tool),
            _lowest_vertex_mm(self.tumor, self.tool, tool_from_tumor),
        )


def _lowest_vertex_mm(moved: SurfaceMesh, fixed: SurfaceMesh, poses: Sequence[Transform]) -> float:
    """The smallest signed distance of a vertex of ``moved``, at any pose, to ``fixed``.

    Intervals of poses are halved. A signed distance changes by at most the motion of its point, and
    no vertex moves further than the farthest corner of the box around them: what cannot be below
    the smallest distance found so far is left out. The result is that over all vertices and poses.
    """
    corners = np.array(list(product(*zip(*moved.bounds_mm, strict=True))))
    motion = np.stack([pose.apply(corners) for pose in poses])
    vertices, faces = np.array(fixed.vertices_mm), fixed.faces.astype(np.int64)
    lowest = np.inf
    intervals = [(0, len(poses), np.arange(len(moved.vertices_mm)))]
    while intervals:
        points = [poses[(a + b) // 2].apply(moved.vertices_mm[use]) for a, b, use in intervals]
        signed, *_ = igl.signed_distance(np.concatenate(points), vertices, faces)
        lowest = min(lowest, float(np.min(signed)))
        parts = np.split(signed, np.cumsum([len(each) for each in points])[:-1])
        halves = []
        for (first, last, use), found in zip(intervals, parts, strict=True):
            middle = (first + last) // 2
            for a, b in ((first, middle), (middle + 1, last)):
                if a < b:
                    moves = np.linalg.norm(motion[a:b] - motion[middle], axis=2).max()
                    halves.append((a, b, use[found - moves < lowest]))
        intervals = [each for each in halves if len(each[2])]
    return lowest


class Truth:
    """The truth that the physics has written to ``path``: one row for each step."""

    def __init__(self, path: Path) -> None:
        with np.load(path) as found:
            stamps, poses = found["stamps"], found["poses"]
        self.ns: FloatArray = stamps[:, 0]
        """Host time of each step."""
        self.phases, self.enabled = stamps[:, 1], stamps[:, 2].astype(bool)
        self._poses = poses

    def tumor_from_tool(self, row: int) -> Transform:
        return self._world_from("tumor", row).inverse() @ self._world_from("tool", row)

    def _world_from(self, body: str, row: int) -> Transform:
        values = self._poses[row, 12:] if body == "tumor" else self._poses[row]
        return Transform("world", body, values[3:12].reshape(3, 3), values[:3])

    def distances_mm(self, engine: ProximityEngine, first: int, last: int) -> FloatArray:
        """The true signed distance (n,) at every step of the rows."""
        rows = range(first, last)
        return np.array(
            [engine.evaluate(self.tumor_from_tool(row)).signed_distance_mm for row in rows]
        )

    def speeds_mm_s(self, first: int, last: int) -> FloatArray:
        """Speed (n,) of the tip in the world, the mean of some steps; 0 at the first row of all."""
        rows = np.arange(first, last)
        before = np.maximum(rows - SMOOTH, 0)
        spent_s = np.maximum(self.ns[rows] - self.ns[before], 1) / NS_PER_S
        moved_mm = self._poses[rows, :3] - self._poses[before, :3]
        return np.asarray(np.linalg.norm(moved_mm, axis=1) / spent_s)

    def own_approach_mm_s(self, engine: ProximityEngine, row: int) -> float:
        """By how much the motion of the tool alone reduces the distance at a step, in mm/s.

        The mean of some steps, with the tumour at its place at the last of them.
        """
        before = max(row - SMOOTH, 0)
        spent_s = max(float(self.ns[row] - self.ns[before]), 1.0) / NS_PER_S
        tumor_from_world = self._world_from("tumor", row).inverse()
        was, now = (
            engine.evaluate(tumor_from_world @ self._world_from("tool", each)).signed_distance_mm
            for each in (before, row)
        )
        return (was - now) / spent_s

    def path_mm(self, first: int) -> float:
        """Largest distance of the tip from its position at a row, from then on."""
        moved = self._poses[first:, :3] - self._poses[first, :3]
        return float(np.linalg.norm(moved, axis=1).max())

    def phase_rows(self, first: int, last: int, phase: Phase) -> tuple[int, int]:
        """First and last row of ``phase`` among the rows of a push."""
        rows = first + np.flatnonzero(self.phases[first:last] == phase)
        return (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (first, first)
