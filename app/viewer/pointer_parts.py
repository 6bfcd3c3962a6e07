"""The pointer in the picture: it drags the tool or a body, or moves the camera."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from app.fixture import MarginState
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, InputError
from app.runtime import SimulatedWorld
from app.viewer.drawing.grips import BodyGrip, ToolGrip
from app.viewer.drawing.scene_view import SceneView
from app.viewer.messages.methods import Area, Event
from app.viewer.view_state import ViewState


class PointerArea:
    """`Area` that gives each event to the first of ``parts`` that takes it, else to ``area``."""

    def __init__(self, area: Area, parts: "Sequence[PointerPart]") -> None:
        self._area, self._parts = area, parts

    def update_size(self, origin: str, size: dict[str, float], /) -> None:
        """Use the size of the area on the page."""
        self._area.update_size(origin, size)

    def on_interaction(self, origin: str, event: Event, /) -> None:
        """Process an event of the pointer."""
        if not any(part.take(origin, event) for part in self._parts):
            self._area.on_interaction(origin, event)


def place_of(event: Event) -> FloatArray:
    """Place (2,) of the pointer in the picture: right and up, 0 to 1."""
    return np.array([event["x"] / event["w"], event["y"] / event["h"]])


STIFFNESS_N_MM = 0.5
"""Force of the spring for each mm between the tip and the point that it is pulled to."""
MAX_FORCE_N = 10.0
MAX_RISE_N_S = 100.0
"""The force rises at most as fast; it falls to 0 at once."""
MAX_SILENCE_NS = 500 * NS_PER_MS
"""A page sends requests all the time, five in a second at least: one that does not has let go."""


class MouseHand:
    """The spring by which the one page that holds the tool pulls it. Thread-safe.

    ``clock_ns`` is a steady clock. A page holds the tool from `hold` to `release`, or until it has
    been silent for `MAX_SILENCE_NS`; another one cannot take it meanwhile.
    """

    def __init__(self, clock_ns: Callable[[], int]) -> None:
        self._clock_ns = clock_ns
        self._lock = threading.Lock()
        self._page: str | None = None
        self._heard_ns = 0
        self._target_mm: FloatArray = np.zeros(3)
        self._force_n: FloatArray = np.zeros(3)
        self._computed_ns = 0

    def hold(self, page: str, target_mm: FloatArray) -> bool:
        """Let ``page`` pull the tip to ``target_mm`` (3,) in the tumour's frame.

        False, and no change, while another page holds the tool or if the point is not finite.
        """
        with self._lock:
            self._expire()
            if self._page not in (None, page) or not np.isfinite(target_mm).all():
                return False
            if self._page is None:
                self._force_n, self._computed_ns = np.zeros(3), self._clock_ns()
            self._page, self._heard_ns = page, self._clock_ns()
            self._target_mm = np.array(target_mm, dtype=np.float64)
            return True

    def heard(self, page: str) -> None:
        """Record that ``page`` is alive."""
        with self._lock:
            self._expire()
            if page == self._page:
                self._heard_ns = self._clock_ns()

    def release(self, page: str) -> None:
        """Let go of the tool, if ``page`` holds it."""
        with self._lock:
            if page == self._page:
                self._let_go()

    def holder(self) -> str | None:
        """The page that holds the tool."""
        with self._lock:
            self._expire()
            return self._page

    def target_mm(self) -> FloatArray | None:
        """The point (3,) in the tumour's frame that the tip is pulled to; None if it is not."""
        with self._lock:
            self._expire()
            return None if self._page is None else self._target_mm.copy()

    def last_force_n(self) -> float:
        """Size in N of the last result of `force_n`, 0 after a release."""
        with self._lock:
            self._expire()
            return float(np.linalg.norm(self._force_n))

    def force_n(self, shown: ViewState | None) -> FloatArray:
        """The force (3,) in N on the tip in ``shown``, the present, along the tool's axes.

        0 unless a page holds the tool and the session knows where it is.
        """
        with self._lock:
            self._expire()
            now_ns, before_ns = self._clock_ns(), self._computed_ns
            self._computed_ns = now_ns
            pose = None if shown is None else shown.step.tumor_from_tip
            is_known = shown is not None and shown.step.decision.state is not MarginState.UNKNOWN
            if self._page is None or pose is None or not is_known:
                self._force_n = np.zeros(3)
                return self._force_n.copy()
            pull = STIFFNESS_N_MM * (self._target_mm - pose.translation_mm)
            rise_n = MAX_RISE_N_S * max(now_ns - before_ns, 0) / NS_PER_S
            limit_n = min(MAX_FORCE_N, float(np.linalg.norm(self._force_n)) + rise_n)
            size_n = float(np.linalg.norm(pull))
            if size_n > limit_n:
                pull = pull * (limit_n / size_n)
            self._force_n = pose.rotation.T @ pull
            return self._force_n.copy()

    def _expire(self) -> None:
        if self._page is not None and self._clock_ns() - self._heard_ns > MAX_SILENCE_NS:
            self._let_go()

    def _let_go(self) -> None:
        self._page, self._force_n = None, np.zeros(3)


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


class PageDrag(ABC):
    """Takes the events of the pointer from a press to its release; a `PointerPart`.

    One page drags at a time. All calls come from the page's thread, events from pages that may
    operate.
    """

    def __init__(self) -> None:
        self._page: str | None = None

    @abstractmethod
    def _begin(self, event: Event) -> bool:
        """True if ``event`` begins a drag."""

    @abstractmethod
    def _move(self, event: Event) -> bool:
        """Follow the pointer; False ends the drag."""

    def take(self, page: str, event: Event, /) -> bool:
        """Process an event of ``page``; False if it is for others."""
        if self._page is None:
            is_begun = self._begin(event)
            if is_begun:
                self._page = page
            return is_begun
        if page != self._page:
            return False
        kind = event["type"]
        goes_on = kind not in ("MouseMove", "LeftButtonRelease") or self._move(event)
        if not goes_on or kind == "LeftButtonRelease" or "Press" in kind:
            self._page = None
        return True

    def gone(self, page: str, /) -> None:
        """End the drag: ``page`` is closed."""
        if page == self._page:
            self._page = None


PointerPart = HandPart | PageDrag
"""A part of the page that takes pointer events."""


class BodyDrag(PageDrag):
    """Drags a body, with the shift key.

    Each event requests a pose; what the picture shows is what the physics makes of it.
    """

    def __init__(self, view: SceneView, world: SimulatedWorld) -> None:
        super().__init__()
        self._world = world
        self._grip = BodyGrip(view, lambda name: world.moment().poses.get(name))

    def _begin(self, event: Event) -> bool:
        is_asked = event["type"] == "LeftButtonPress" and event["shiftKey"]
        if not is_asked or event["ctrlKey"] or event["altKey"]:
            return False
        return self._grip.grip(place_of(event)) is not None

    def _move(self, event: Event) -> bool:
        pose = self._grip.moved_to(place_of(event))
        if pose is not None:
            try:
                self._world.place(pose)
            except InputError:  # the page shows that no simulation receives requests
                return False
        return True
