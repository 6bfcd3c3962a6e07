"""The part of the page that shows ultrasound: the plane in the 3D view, and the image beside it."""

import base64
from typing import Any

from app.case import ImageSource
from app.geometry import FloatArray
from app.scene import QUICK_TYPE, ImagePlane, MarginGuardScene, quick_image
from app.viewer.drawing.scene_view import SceneView
from app.viewer.readout.ultrasound import eight_bits, ultrasound_values
from app.viewer.steps.ultrasound import ImageView, Ultrasound
from app.viewer.steps.view_state import ViewState


class UltrasoundPart:
    """Shows ``images`` in the page's thread. The plane is hidden while no image is current."""

    def __init__(self, images: ImageSource) -> None:
        self._ultrasound = Ultrasound(images)
        self._view = ImageView(None, None, "no image yet")
        self._plane: ImagePlane | None = None
        self._scene: MarginGuardScene | None = None
        self._sent: int | None = None

    @property
    def plane(self) -> ImagePlane | None:
        """The plane in the 3D view; None before there is a scene."""
        return self._plane

    def update(self, shown: ViewState | None, view: SceneView) -> None:
        """Show the image of ``shown`` in the scene of ``view``."""
        scene = view.scene
        if scene is not self._scene:
            if self._plane is not None:
                self._plane.remove()
            self._scene, self._plane = scene, None
        found = self._view = self._ultrasound.at(shown, None if scene is None else scene.reference)
        if scene is None:
            return
        root = scene.tree.node(scene.reference)
        if self._plane is None and root is not None:
            self._plane = ImagePlane(scene.scene, root)
        if self._plane is None:
            return
        if found.image is None or found.matrix is None:
            self._plane.hide()
        else:
            self._plane.show(eight_bits(found.image), found.matrix)

    def place(self, shown: ViewState | None, frame: str) -> tuple[int, FloatArray] | None:
        """The present image and its map (4, 4) to mm in ``frame``; None if none may be shown."""
        if shown is None or shown.silent or self._view.problem or self._view.number is None:
            return None
        found = self._ultrasound.images.at(shown.step.frame.stamp.ns, frame)
        if found.number is None or found.pose.matrix is None:
            return None
        return found.number, found.pose.matrix

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last `update`; the image if it is another."""
        image, size = self._view.image, self._ultrasound.images.size or (1, 1)
        found: dict[str, Any] = {"ultrasound": ultrasound_values(self._view, size)}
        if image is not None and image.number != self._sent:
            self._sent = image.number
            content = base64.b64encode(quick_image(eight_bits(image))).decode()
            found["ultrasound_image"] = {
                "number": image.number,
                "src": f"data:{QUICK_TYPE};base64,{content}",
            }
        return found
