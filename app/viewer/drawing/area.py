"""The picture's area on the page: takes pointer events, but no keys."""

from typing import Any

from trame_rca.rca import VtkRemoteControlledArea
from trame_slicer.views import ThreeDView

DEFAULT_SIZE = (1280, 800)
"""Size of a picture before a page has sent one."""
_MIN_SIDE, _MAX_SIDE = 16, 4096
_POINTER_EVENTS = ("Button", "Wheel", "MouseMove", "Pinch", "Pan", "Rotate", "Tap")


class PictureArea(VtkRemoteControlledArea):  # type: ignore[misc]  # trame has no types
    """Renders a view, and lets the pointer on the page move its camera.

    Key events are ignored: VTK switches to wireframe at some keys, and ends its loop at others.
    """

    def __init__(self, view: ThreeDView) -> None:
        super().__init__(view.render_window())
        self._view = view
        self._grabbed = False
        self._size: tuple[int, int] | None = DEFAULT_SIZE

    def process_interaction_event(self, event: dict[str, Any]) -> None:
        """Process an event of a mouse or a touch screen."""
        kind = str(event["type"])
        if any(name in kind for name in _POINTER_EVENTS):
            self._grabbed |= "Press" in kind or "Start" in kind
            super().process_interaction_event(event)

    def process_resize_event(self, width: int, height: int) -> None:
        """Use the size of the area on the page, in pixels, from the next picture on."""
        self._size = _within_limits(width), _within_limits(height)

    def take_grabbed(self) -> bool:
        """Return True if the pointer has grabbed the view since the last call."""
        grabbed, self._grabbed = self._grabbed, False
        return grabbed

    def take_resized(self) -> bool:
        """Apply a new size; return True if there was one since the last call."""
        size, self._size = self._size, None
        if size is not None:
            super().process_resize_event(*size)
        return size is not None

    def set_high_quality(self, high_quality: bool) -> None:
        """Smooth edges and sort translucent surfaces, which takes three times as long."""
        renderer = self._view.renderer()
        renderer.SetUseFXAA(high_quality)
        renderer.SetUseDepthPeeling(high_quality)


def _within_limits(side: int) -> int:
    return min(max(side, _MIN_SIDE), _MAX_SIDE)
