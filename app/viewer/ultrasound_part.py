"""The part of the page that shows ultrasound: the plane in the 3D view, and the image beside it."""

from collections import deque
from typing import Any

from aiohttp import web

from app.case import CaseImages
from app.scene import ImagePlane, MarginGuardScene, quick_png
from app.viewer.drawing.scene_view import SceneView
from app.viewer.readout.ultrasound import eight_bits, ultrasound_values
from app.viewer.steps.ultrasound import ImageView, Ultrasound
from app.viewer.steps.view_state import ViewState

_RECENT = 8
"""Images that a page may still request: those that the last values have named."""


class UltrasoundPart:
    """Shows ``images`` in the page's thread. The plane is hidden while no image is current."""

    def __init__(self, images: CaseImages) -> None:
        self._ultrasound = Ultrasound(images)
        self._view = ImageView(None, None, "no image yet")
        self._plane: ImagePlane | None = None
        self._scene: MarginGuardScene | None = None
        self._recent: deque[int] = deque(maxlen=_RECENT)
        self._png: tuple[int, bytes] | None = None

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

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last `update`."""
        number = self._view.number
        if number is not None and not self._view.problem and number not in self._recent:
            self._recent.append(number)
        size = self._ultrasound.images.sequence.size
        return {"ultrasound": ultrasound_values(self._view, size)}

    async def picture(self, request: web.Request) -> web.Response:
        """The image whose number the page requests, one of the last shown; 404 for others."""
        text = request.query.get("image", "")
        number = int(text) if text.isascii() and text.isdigit() and len(text) < 10 else -1
        if number not in self._recent:
            raise web.HTTPNotFound
        if self._png is None or self._png[0] != number:
            self._png = number, quick_png(eight_bits(self._ultrasound.image(number)))
        return web.Response(
            body=self._png[1], content_type="image/png", headers={"Cache-Control": "no-store"}
        )
