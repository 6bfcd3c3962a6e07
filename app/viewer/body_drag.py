"""The mouse on a body of a simulated world: an operator drags it, holding the shift key."""

from app.geometry import InputError
from app.runtime import SimulatedWorld
from app.viewer.drawing.body_grip import BodyGrip
from app.viewer.drawing.scene_view import SceneView
from app.viewer.messages.events import Event
from app.viewer.pointer_area import place_of


class BodyDrag:
    """Takes the events of the pointer that drag a body; a `PointerPart`.

    Each event requests a pose; what the picture shows is what the physics makes of it. One page
    drags at a time. All calls come from the page's thread, events from pages that may operate.
    """

    def __init__(self, view: SceneView, world: SimulatedWorld) -> None:
        self._world = world
        self._grip = BodyGrip(view, lambda name: world.moment().poses.get(name))
        self._page: str | None = None

    def take(self, page: str, event: Event, /) -> bool:
        """Process an event of ``page``; False if it is for others."""
        kind = event["type"]
        if self._page is None:
            is_asked = kind == "LeftButtonPress" and event["shiftKey"]
            if not is_asked or event["ctrlKey"] or event["altKey"]:
                return False
            if self._grip.grip(place_of(event)) is None:
                return False
            self._page = page
            return True
        if page != self._page:
            return False
        if kind in ("MouseMove", "LeftButtonRelease"):
            self._move(event)
        if kind == "LeftButtonRelease" or "Press" in kind:
            self._page = None
        return True

    def gone(self, page: str, /) -> None:
        """Let go of a body: ``page`` is closed."""
        if page == self._page:
            self._page = None

    def _move(self, event: Event) -> None:
        pose = self._grip.moved_to(place_of(event))
        if pose is None:
            return
        try:
            self._world.place(pose)
        except InputError:  # the page shows that no simulation receives requests
            self._page = None
