"""The part of the page with which an operator's mouse drags the tool."""

from typing import Any

import numpy as np

from app.geometry import FloatArray
from app.viewer.drawing.scene_view import SceneView
from app.viewer.drawing.tool_grip import ToolGrip
from app.viewer.messages.events import Event
from app.viewer.pointer_area import place_of
from app.viewer.steps.mouse_hand import MouseHand

_PRESS, _MOVE, _RELEASE = "LeftButtonPress", "MouseMove", "LeftButtonRelease"


class HandPart:
    """Gives pointer events on the tool to ``hand``, and the others to the camera of ``view``.

    All calls come from the page's thread. Events come from pages that may operate, see `Methods`.
    """

    def __init__(self, view: SceneView, hand: MouseHand) -> None:
        self._hand = hand
        self._grip = ToolGrip(view)

    def take(self, page: str, event: Event) -> bool:
        """Process an event of ``page``; False if it is for the camera."""
        kind = event["type"]
        if kind == _PRESS and not any(event[key] for key in ("ctrlKey", "altKey", "shiftKey")):
            tip_mm = self._grip.grip(place_of(event)) if self._hand.holder() is None else None
            return tip_mm is not None and self._hand.hold(page, tip_mm)
        if self._hand.holder() != page:
            return False
        if kind == _RELEASE:
            self._hand.release(page)
        elif kind == _MOVE:
            target_mm = self._grip.pulled_to(place_of(event))
            if target_mm is None or not self._hand.hold(page, target_mm):
                self._hand.release(page)
        elif "Press" in kind:  # another button: the camera does not move while the tool is held
            self._hand.release(page)
        return True

    def heard(self, page: str) -> None:
        """Record that ``page`` is alive."""
        self._hand.heard(page)

    def gone(self, page: str) -> None:
        """Let go of the tool: ``page`` is closed."""
        self._hand.release(page)

    def values(self) -> dict[str, Any]:
        """The values of the page: where tip and pull are in the picture, in percent, and the force.

        ``hand`` is None while the tool is not in the picture.
        """
        tip = self._grip.tip_at()
        if tip is None or not np.isfinite(tip).all():
            return {"hand": None}
        target_mm = self._hand.target_mm()
        pulled = None if target_mm is None else self._grip.shown_at(target_mm)
        is_shown = pulled is not None and bool(np.isfinite(pulled).all())
        return {
            "hand": {
                "tip": _percent(tip),
                "pulled": _percent(pulled) if pulled is not None and is_shown else None,
                "force": f"{self._hand.last_force_n():.1f}",
            }
        }


def _percent(at: FloatArray) -> list[float]:
    """Place in the page's axes: right and down, in percent."""
    return [round(100.0 * float(at[0]), 2), round(100.0 * float(1.0 - at[1]), 2)]
