"""Grips the tool or a body of a simulated world in the picture, and moves it with the pointer."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, Transform
from app.scene.convert import world_matrix, world_points, world_triangles
from app.viewer.drawing.scene_view import Part, SceneView


class PicturePoints:
    """The projection of the camera of ``view``.

    Points of the picture are (x, y): right and up, 0 to 1; points of the scene are in RAS mm.
    """

    def __init__(self, view: SceneView) -> None:
        self._view = view

    def size(self) -> tuple[int, int]:
        """Width and height of the picture in pixels."""
        width, height = self._view.view.render_window().GetSize()
        return int(width), int(height)

    def projected(self, points_mm: FloatArray) -> FloatArray:
        """Points (n, 3) in the picture, (n, 2); NaN behind the camera."""
        placed = np.column_stack([points_mm, np.ones(len(points_mm))]) @ self._matrix().T
        depth = np.where(placed[:, 3] > 0.0, placed[:, 3], np.nan)
        return np.asarray(0.5 + 0.5 * placed[:, :2] / depth[:, None])

    def on_plane(self, at: FloatArray, through_mm: FloatArray) -> FloatArray | None:
        """The point (3,) under ``at`` in the plane through a point that faces the camera.

        None for a plane behind the camera.
        """
        placed = self._matrix() @ [*through_mm, 1.0]
        # A plane that faces the camera has one depth in the picture.
        return None if placed[3] <= 0.0 else self._at_depth(at, placed[2] / placed[3])

    def ray(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The line that the picture shows at ``at``: its near and its far end, (3,) each."""
        return self._at_depth(at, -1.0), self._at_depth(at, 1.0)

    def _at_depth(self, at: FloatArray, depth: float) -> FloatArray:
        found = np.linalg.inv(self._matrix()) @ [2.0 * at[0] - 1.0, 2.0 * at[1] - 1.0, depth, 1.0]
        return np.asarray(found[:3] / found[3])

    def _matrix(self) -> FloatArray:
        """From RAS to the picture, (4, 4)."""
        width, height = self.size()
        matrix = (
            self._view.view.renderer()
            .GetActiveCamera()
            .GetCompositeProjectionTransformMatrix(width / max(height, 1), -1.0, 1.0)
        )
        return np.array(matrix.GetData()).reshape(4, 4)


REACH = 0.03
"""The tool is gripped within this part of the picture's height."""


class ToolGrip:
    """The tool of ``view`` under the pointer, which moves it in the plane that faces the camera.

    Points of the picture are (x, y): right and up, 0 to 1.
    """

    def __init__(self, view: SceneView) -> None:
        self._view, self._picture = view, PicturePoints(view)
        self._tip_mm: FloatArray = np.zeros(3)
        self._offset_mm: FloatArray = np.zeros(3)

    def grip(self, at: FloatArray) -> FloatArray | None:
        """Grip the tool at ``at`` (2,); the point (3,) of its tip in the tumour's frame.

        None if the tool is not there, or not in the scene.
        """
        frames = self._frames()
        if frames is None or self._view.scene is None or self._view.scene.tool is None:
            return None
        ras_from_tumor, tip_mm = frames
        width, height = self._picture.size()
        scale = np.array([width / height, 1.0])
        points = self._picture.projected(world_points(self._view.scene.tool)) * scale
        mesh = self._view.content.tool
        edges = (
            np.zeros((1, 2), dtype=np.int64)
            if mesh is None
            else np.concatenate([mesh.faces[:, :2], mesh.faces[:, 1:]])
        )
        if points[:, 0].size <= edges.max() or not np.isfinite(points).all():
            return None
        if distance_to_segments(at * scale, points[edges[:, 0]], points[edges[:, 1]]) > REACH:
            return None
        on_plane = self._picture.on_plane(at, tip_mm)
        if on_plane is None:
            return None
        tumor_from_ras = np.linalg.inv(ras_from_tumor)
        self._tip_mm = (tumor_from_ras @ [*tip_mm, 1.0])[:3]
        self._offset_mm = tip_mm - on_plane
        return self._tip_mm.copy()

    def pulled_to(self, at: FloatArray) -> FloatArray | None:
        """Where the pointer at ``at`` (2,) pulls the tip, (3,) in the tumour's frame, after `grip`.

        None where the picture shows no such point.
        """
        frames = self._frames()
        if frames is None:
            return None
        ras_from_tumor, _ = frames
        depth_mm = (ras_from_tumor @ [*self._tip_mm, 1.0])[:3]
        on_plane = self._picture.on_plane(at, depth_mm)
        if on_plane is None:
            return None
        found: FloatArray = np.linalg.inv(ras_from_tumor) @ [*(on_plane + self._offset_mm), 1.0]
        return found[:3]

    def tip_at(self) -> FloatArray | None:
        """Where the tip is in the picture, (2,); None while it is not in the scene."""
        frames = self._frames()
        return None if frames is None else self._picture.projected(frames[1][None])[0]

    def shown_at(self, point_mm: FloatArray) -> FloatArray | None:
        """Where ``point_mm`` (3,) of the tumour's frame is in the picture, (2,)."""
        frames = self._frames()
        if frames is None:
            return None
        in_ras: FloatArray = frames[0] @ [*point_mm, 1.0]
        at: FloatArray = self._picture.projected(in_ras[None, :3])[0]
        return at

    def _frames(self) -> tuple[FloatArray, FloatArray] | None:
        """``ras_from_tumor`` (4, 4), and the tip (3,) in RAS; None while they are not known."""
        scene = self._view.scene
        if scene is None or scene.tumor is None:
            return None
        tip = scene.tree.node(self._view.content.tip_frame)
        tumor = scene.tumor.GetParentTransformNode()
        if tip is None or tumor is None:
            return None
        return world_matrix(tumor), world_matrix(tip)[:3, 3]


def distance_to_segments(point: FloatArray, first: FloatArray, second: FloatArray) -> float:
    """Distance of ``point`` (2,) to the nearest of the segments between two arrays (n, 2)."""
    along = second - first
    length = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((point - first) * along).sum(axis=1) / length, 0.0, 1.0)
    nearest = first + share[:, None] * along
    return float(np.linalg.norm(nearest - point, axis=1).min())


_PARALLEL = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class _Gripped:
    name: str
    world_from_body: Transform
    at_mm: FloatArray
    """The gripped point (3,) in the world's frame."""


class BodyGrip:
    """The body of ``view`` under the pointer, which moves it in the plane that faces the camera.

    Points of the picture are (x, y): right and up, 0 to 1. ``pose_of(name)`` is the present
    ``world_from_body``, None for a body that is not there.
    """

    def __init__(self, view: SceneView, pose_of: Callable[[str], Transform | None]) -> None:
        self._view, self._picture = view, PicturePoints(view)
        self._pose_of = pose_of
        self._gripped: _Gripped | None = None

    def grip(self, at: FloatArray) -> str | None:
        """Grip the nearest body that the picture shows at ``at`` (2,); its name, None without."""
        self._gripped = None
        if not self._view.visible(Part.BODIES):
            return None
        near, far = self._picture.ray(at)
        found: tuple[float, str] | None = None
        for name, model in self._view.bodies.items():
            share = first_hit(near, far, world_triangles(model))
            if share is not None and (found is None or share < found[0]):
                found = share, name
        if found is None:
            return None
        share, name = found
        pose, world = self._pose_of(name), self._ras_from_world(name)
        if pose is None or world is None:
            return None
        point: FloatArray = np.linalg.inv(world) @ [*(near + share * (far - near)), 1.0]
        self._gripped = _Gripped(name, pose, point[:3])
        return name

    def moved_to(self, at: FloatArray) -> Transform | None:
        """``world_from_body`` that brings the gripped point under ``at`` (2,), after `grip`.

        None where the picture shows no such point.
        """
        gripped = self._gripped
        world = None if gripped is None else self._ras_from_world(gripped.name)
        if gripped is None or world is None:
            return None
        in_ras: FloatArray = world @ [*gripped.at_mm, 1.0]
        target = self._picture.on_plane(at, in_ras[:3])
        if target is None:
            return None
        point: FloatArray = np.linalg.inv(world) @ [*target, 1.0]
        before = gripped.world_from_body
        place_mm = before.translation_mm + point[:3] - gripped.at_mm
        return Transform(before.target, before.source, before.rotation, place_mm)

    def _ras_from_world(self, name: str) -> FloatArray | None:
        """(4, 4); None for a body that is not in the scene."""
        model = self._view.bodies.get(name)
        frame = None if model is None else model.GetParentTransformNode()
        return None if frame is None else world_matrix(frame.GetParentTransformNode())


def first_hit(start: FloatArray, end: FloatArray, triangles: FloatArray) -> float | None:
    """Where the segment between two points (3,) first meets ``triangles`` (n, 3, 3), 0 to 1.

    None where it meets none (Moeller and Trumbore 1997).
    """
    along = end - start
    first, edge, other = (
        triangles[:, 0],
        triangles[:, 1] - triangles[:, 0],
        triangles[:, 2] - triangles[:, 0],
    )
    normal = np.cross(along, other)
    scale = (edge * normal).sum(axis=1)
    is_met = np.abs(scale) > _PARALLEL
    inverse = 1.0 / np.where(is_met, scale, 1.0)
    offset = start - first
    u = inverse * (offset * normal).sum(axis=1)
    across = np.cross(offset, edge)
    v = inverse * (across @ along)
    share = inverse * (across * other).sum(axis=1)
    is_met &= (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (share >= 0.0) & (share <= 1.0)
    return float(share[is_met].min()) if is_met.any() else None
