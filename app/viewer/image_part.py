"""The part of the page that shows images: the plane in the 3D view, and the image beside it."""

import base64
from typing import Any

from app.case import ImageSource
from app.files.volume_file import Volume
from app.geometry import FloatArray
from app.scene import QUICK_TYPE, ImagePlane, MarginGuardScene, quick_image
from app.viewer.drawing.scene_view import SceneView
from app.viewer.readout.ultrasound import eight_bits, ultrasound_values
from app.viewer.steps.plane_lines import ImageView
from app.viewer.steps.reslice import SIDE, Reslice, ReslicePlane
from app.viewer.steps.ultrasound import Ultrasound
from app.viewer.steps.view_state import ViewState

ULTRASOUND = "ultrasound"


def image_kinds(images: ImageSource | None, volume: Volume | None) -> tuple[str, ...]:
    """The kinds of images that a page can show of them; the first one is shown at first."""
    planes = () if volume is None else tuple(plane.value for plane in ReslicePlane)
    return planes if images is None else (ULTRASOUND, *planes)


class ImagePart:
    """Shows ``images`` and cuts of ``volume`` in the page's thread, one kind at a time.

    The plane is hidden while no image is current. At least one of both is given.
    """

    def __init__(self, images: ImageSource | None, volume: Volume | None = None) -> None:
        self._ultrasound = None if images is None else Ultrasound(images)
        self._reslice = None if volume is None else Reslice(volume)
        self.kind = image_kinds(images, volume)[0]
        """The kind that is shown, one of `image_kinds`."""
        self._view = ImageView(None, None, "no image yet")
        self._plane: ImagePlane | None = None
        self._scene: MarginGuardScene | None = None
        self._sent: int | None = None
        self._place: tuple[int, FloatArray] | None = None

    @property
    def has_ultrasound(self) -> bool:
        """True if there are ultrasound images, whatever is shown."""
        return self._ultrasound is not None

    @property
    def plane(self) -> ImagePlane | None:
        """The plane in the 3D view; None before there is a scene."""
        return self._plane

    @property
    def place(self) -> tuple[int, FloatArray] | None:
        """The number of the ultrasound image that is shown, and its map (4, 4) to mm.

        The map is to the ``frame`` of `update`. None if no image is shown, or one of another kind.
        """
        return self._place

    def update(self, shown: ViewState | None, view: SceneView, frame: str | None = None) -> None:
        """Show the image of ``shown`` in the scene of ``view``, and place it in ``frame``."""
        scene = view.scene
        if scene is not self._scene:
            if self._plane is not None:
                self._plane.remove()
            self._scene, self._plane = scene, None
        root = None if scene is None else scene.reference
        found = self._view = self._at(shown, root)
        placed = self._placed(shown, frame)
        if placed is not None and placed[0] != found.number:  # an image has come in between
            found = self._view = self._at(shown, root)
        self._place = placed if placed is not None and placed[0] == found.number else None
        if scene is None:
            return
        node = scene.tree.node(scene.reference)
        if self._plane is None and node is not None:
            self._plane = ImagePlane(scene.scene, node)
        if self._plane is None:
            return
        if found.image is None or found.matrix is None:
            self._plane.hide()
        else:
            self._plane.show(eight_bits(found.image), found.matrix)

    def _at(self, shown: ViewState | None, root: str | None) -> ImageView:
        if self.kind == ULTRASOUND and self._ultrasound is not None:
            return self._ultrasound.at(shown, root)
        assert self._reslice is not None
        return self._reslice.at(shown, root, ReslicePlane(self.kind))

    def _placed(self, shown: ViewState | None, frame: str | None) -> tuple[int, FloatArray] | None:
        """The present ultrasound image and its map (4, 4) to mm in ``frame``.

        None if none may be shown, or if the page shows another kind of image.
        """
        if self.kind != ULTRASOUND or self._ultrasound is None or frame is None:
            return None
        if shown is None or shown.silent or self._view.problem or self._view.number is None:
            return None
        found = self._ultrasound.images.at(shown.step.frame.stamp.ns, frame)
        if found.number is None or found.pose.matrix is None:
            return None
        return found.number, found.pose.matrix

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last `update`; the image if it is another."""
        image, size = self._view.image, (SIDE, SIDE)
        if self.kind == ULTRASOUND and self._ultrasound is not None:
            size = self._ultrasound.images.size or (1, 1)
        values = {"kind": self.kind, **ultrasound_values(self._view, size)}
        found: dict[str, Any] = {"ultrasound": values}
        if image is not None and image.number != self._sent:
            self._sent = image.number
            content = base64.b64encode(quick_image(eight_bits(image))).decode()
            found["ultrasound_image"] = {
                "number": image.number,
                "src": f"data:{QUICK_TYPE};base64,{content}",
            }
        return found
