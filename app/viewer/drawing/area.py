"""The picture's area on the page: hands reach the view from there, the keyboard does not."""

from typing import Any

from trame_rca.rca import VtkRemoteControlledArea
from trame_slicer.views import ThreeDView

_HANDS = ("Button", "Wheel", "MouseMove", "Pinch", "Pan", "Rotate", "Tap")


class PictureArea(VtkRemoteControlledArea):  # type: ignore[misc]  # trame has no types
    """Draws a view, and turns it as a hand on the page says.

    Keys belong to the page: VTK would make wireframes of some, and end its loop at others.
    """

    def __init__(self, view: ThreeDView) -> None:
        super().__init__(view.render_window())
        self._view = view
        self._grabbed = False
        self._resized = False

    def process_interaction_event(self, event: dict[str, Any]) -> None:
        """Take an event of a mouse or of fingers."""
        kind = str(event["type"])
        if any(word in kind for word in _HANDS):
            self._grabbed |= "Press" in kind or "Start" in kind
            super().process_interaction_event(event)

    def process_resize_event(self, width: int, height: int) -> None:
        """Take the size of the area on the page, in pixels."""
        super().process_resize_event(width, height)
        self._resized = True

    def was_grabbed(self) -> bool:
        """Whether a hand took hold of the view since the last call."""
        grabbed, self._grabbed = self._grabbed, False
        return grabbed

    def was_resized(self) -> bool:
        """Whether the area has another size than at the last call."""
        resized, self._resized = self._resized, False
        return resized

    def set_fine(self, fine: bool) -> None:
        """Smooth edges and sorted translucency: three times the cost, for a picture that stays."""
        renderer = self._view.renderer()
        renderer.SetUseFXAA(fine)
        renderer.SetUseDepthPeeling(fine)
