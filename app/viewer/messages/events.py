"""Events of the picture on the page: its size and the pointer.

VTK ends the process at some incomplete events (a text as a coordinate), and takes values that put
its camera at infinity. Only events that have all values, within ranges, are passed on.
"""

from collections.abc import Callable
from typing import Any

from app.viewer.messages.checks import flag, mapping, number, one_of, refused

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
    """The event with the values that it needs and no other; None if the server ignores its type."""
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
