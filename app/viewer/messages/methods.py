"""The methods that a page may call: what is not listed here does not exist for it."""

from collections.abc import Callable
from typing import Any, Protocol

from trame_server import Server

from app.viewer.address import Role
from app.viewer.log import log
from app.viewer.messages.checks import (
    Command,
    Commands,
    RefusedError,
    empty,
    flag,
    integer,
    mapping,
    number,
    one_of,
    refused,
    shown,
    text,
)
from app.viewer.messages.open_pages import MAX_MESSAGE_BYTES, OpenPage

_MAX_SIDE = 20_000.0
"""Largest side of the picture's area on the page."""
_MAX_ZOOM = 100.0
_MAX_TURN_DEG = 3600.0
_MAX_FINGERS = 10
_MAX_SPIN = 100.0

_side = number(1.0, _MAX_SIDE)
_size = number(0.0, _MAX_SIDE)  # 0 while the area is hidden
_offset = number(-_MAX_SIDE, _MAX_SIDE)
_pixel_ratio = number(0.1, 10.0)
_factor = number(1.0 / _MAX_ZOOM, _MAX_ZOOM)
_turn = number(-_MAX_TURN_DEG, _MAX_TURN_DEG)
_spin = number(-_MAX_SPIN, _MAX_SPIN)

Event = dict[str, Any]
_Complete = Callable[[Event], Event]


def area_size(value: object) -> dict[str, float]:
    """The picture's area: width ``w`` and height ``h``, with ``p`` screen pixels for each unit."""
    size = mapping(value)
    return {
        "w": _size(size.get("w")),
        "h": _size(size.get("h")),
        "p": _pixel_ratio(size.get("p", 1)),
    }


def pointer_event(value: object) -> Event | None:
    """The event with the values that it needs and no other; None if the server ignores its type.

    VTK ends the process at some incomplete events (a text as a coordinate), and takes values that
    put its camera at infinity. Only events that have all values, within ranges, are passed on.
    """
    event = mapping(value)
    kind = _known_type(event.get("type"))
    complete = _USED.get(kind)
    return None if complete is None else {"type": kind, **complete(event)}


def _mouse(event: Event) -> Event:
    return {**_area(event), **_at(event), **_keys(event)}


def _wheel(event: Event) -> Event:
    return {**_mouse(event), "spinY": _spin(event.get("spinY"))}


def _tap(event: Event) -> Event:
    return {**_area(event), "position": _at(mapping(event.get("position")))}


def _pinch(event: Event) -> Event:
    return {**_touch(event), "factor": _factor(event.get("factor"))}


def _pan(event: Event) -> Event:
    given = event.get("translation")
    if not isinstance(given, list) or len(given) != 2:
        raise refused(given, "two numbers")
    return {**_touch(event), "translation": [_offset(each) for each in given]}


def _rotate(event: Event) -> Event:
    return {**_touch(event), "rotation": _turn(event.get("rotation"))}


def _touch(event: Event) -> Event:
    positions = mapping(event.get("positions"))
    if not 1 <= len(positions) <= _MAX_FINGERS:
        raise refused(positions, f"1 to {_MAX_FINGERS} positions")
    fingers = {str(n): _at(mapping(at)) for n, at in enumerate(positions.values())}
    return {**_area(event), "positions": fingers}


def _area(event: Event) -> Event:
    return {"w": _side(event.get("w")), "h": _side(event.get("h"))}


def _at(event: Event) -> Event:
    return {"x": _offset(event.get("x")), "y": _offset(event.get("y"))}


def _keys(event: Event) -> Event:
    return {key: flag(event.get(key, 0)) for key in ("ctrlKey", "altKey", "shiftKey")}


_BUTTONS = [
    f"{side}Button{how}" for side in ("Left", "Middle", "Right") for how in ("Press", "Release")
]
_GESTURES: dict[str, _Complete] = {"Pinch": _pinch, "Pan": _pan, "Rotate": _rotate}
_USED: dict[str, _Complete] = {
    **dict.fromkeys(["MouseMove", *_BUTTONS], _mouse),
    "MouseWheel": _wheel,
    **dict.fromkeys(["Tap", "LongTap"], _tap),
    **{f"{when}{name}": _GESTURES[name] for name in _GESTURES for when in ("", "Start", "End")},
}
_IGNORED = (
    *("StartInteractionEvent", "EndInteractionEvent", "StartInteraction", "Interaction"),
    *("EndInteraction", "StartAnimation", "Animation", "EndAnimation", "PointerEnter"),
    *("PointerLeave", "MouseEnter", "MouseLeave", "StartMouseMove", "EndMouseMove", "KeyPress"),
    *("KeyDown", "KeyUp", "StartMouseWheel", "EndMouseWheel", "Button3D", "Move3D"),
    *("StartPointerLock", "EndPointerLock", "AnimationFrameRateUpdate"),
)
_known_type = one_of([*_USED, *_IGNORED], "the type of a pointer event")


HELLO = "wslink.hello"
"""The first message of a page."""
_LIFE_CYCLE = ("client_connected", "client_unmounted", "client_exited")
_MAX_COMMAND_ARGS = 6
_MAX_ERRORS_LOGGED, _MAX_ERROR_CHARS = 5, 400
_STATE_COST = 20.0
"""Cost of sending the whole state, in messages."""
_name = text(64)


class Area(Protocol):
    """The picture's area, as trame's `RcaViewAdapter` offers it."""

    def update_size(self, origin: str, size: dict[str, float], /) -> None:
        """Use the size of the area on the page."""

    def on_interaction(self, origin: str, event: Event, /) -> None:
        """Process an event of the pointer."""


class Methods:
    """Runs the calls of pages. ``area_name`` is the name of ``area`` on the page.

    ``on_ack(page, number)`` is called when a page has received picture ``number``.
    """

    def __init__(
        self,
        server: Server,
        commands: Commands,
        area_name: str,
        area: Area,
        on_ack: Callable[[str, int], None],
    ) -> None:
        self._server = server
        self._commands = commands
        self._area = area
        self._on_ack = on_ack
        place = (one_of([area_name]), _name)
        view, operate = Role.VIEW, Role.OPERATE
        self._methods = {
            HELLO: Command(self._greet, (mapping,), view),
            "trame.state.get": Command(self._state, (), view, _STATE_COST),
            # Nothing here depends on a page's life cycle.
            "trame.lifecycle.update": Command(lambda *_: None, (one_of(_LIFE_CYCLE),), view),
            "trame.error.client": Command(_log_error, (text(MAX_MESSAGE_BYTES),), view),
            "marginguard.seen": Command(self._acknowledge, (integer(0, 2**53),), view),
            # The role that a command needs is checked with its name.
            "trame.trigger": Command(self._run, (_name, _command_args, empty), view),
            "trame.rca.size": Command(self._resize, (*place, area_size), operate),
            "trame.rca.event": Command(self._interact, (*place, pointer_event), operate),
        }

    def cost(self, method: str) -> float:
        """The number of messages that a call counts for."""
        known = self._methods.get(method)
        return 1.0 if known is None else known.cost

    def call(self, page: OpenPage, name: str, args: tuple[Any, ...]) -> object:
        """Run a call of ``page`` and return its result.

        Raises `RefusedError` if there is no such method, or if role or arguments do not permit it.
        """
        method = self._methods.get(name)
        if method is None:
            raise RefusedError(f"method: {shown(name)}; expected one that the page uses")
        return method.call(page, *method.checked(f"method {name}", args, page.role))

    def _greet(self, page: OpenPage, _secret: object) -> dict[str, object]:
        """The socket's request has proved the token; wslink's own secret is a constant."""
        page.greeted = True
        return {"clientID": page.id, "maxMsgSize": MAX_MESSAGE_BYTES}

    def _state(self, page: OpenPage) -> dict[str, object]:
        whole = self._server.protocol.get_server_state()
        # The page sends none of its values: only the server changes them.
        own = {"role": page.role.value, "trame__client_only": [*whole["state"], "role"]}
        return {**whole, "state": {**whole["state"], **own}}

    def _acknowledge(self, page: OpenPage, number: int) -> None:
        page.acknowledge(number)
        self._on_ack(page.id, number)

    def _run(self, page: OpenPage, name: str, args: list[object], _kwargs: None) -> None:
        with self._server.state:
            self._commands.run(name, args, page.role)

    def _resize(self, page: OpenPage, _area: str, _origin: str, size: dict[str, float]) -> None:
        self._area.update_size(page.id, size)

    def _interact(self, page: OpenPage, _area: str, _origin: str, event: Event | None) -> None:
        if event is not None:
            self._area.on_interaction(page.id, event)


def _command_args(value: object) -> list[object]:
    if not isinstance(value, list) or len(value) > _MAX_COMMAND_ARGS:
        raise refused(value, f"a list of at most {_MAX_COMMAND_ARGS} values")
    return value


def _log_error(page: OpenPage, message: str) -> None:
    """Log the first errors of a page's scripts, each in one line of ASCII."""
    page.errors_logged += 1
    if page.errors_logged <= _MAX_ERRORS_LOGGED:
        log.error("%s: error in the browser: %s", page.id, ascii(message)[:_MAX_ERROR_CHARS])
