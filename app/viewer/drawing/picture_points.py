"""From points of the scene to points of the picture, and back."""

import numpy as np

from app.geometry import FloatArray
from app.viewer.drawing.scene_view import SceneView


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
