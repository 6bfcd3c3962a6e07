"""Grips the tool in the picture: from a point of the picture to a point beside the tumour."""

import numpy as np

from app.geometry import FloatArray
from app.scene.convert import world_matrix, world_points
from app.viewer.drawing.picture_points import PicturePoints
from app.viewer.drawing.scene_view import SceneView

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
