"""Grips a body of a simulated world in the picture, and moves it with the pointer."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, Transform
from app.scene.convert import world_matrix, world_triangles
from app.viewer.drawing.picture_points import PicturePoints
from app.viewer.drawing.scene_view import Part, SceneView

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
