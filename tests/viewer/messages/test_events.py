"""Size and pointer events of the picture's area."""

import pytest

from app.viewer.messages.checks import RefusedError
from app.viewer.messages.methods import area_size, pointer_event

AREA = {"w": 930.25, "h": 519.0}
MOUSE = {**AREA, "x": 300, "y": 268.1}
KEYS = {"ctrlKey": 0, "altKey": 0, "shiftKey": 0}
TOUCH = {**AREA, "positions": {"5": {"x": 1, "y": 2, "z": 0}, "6": {"x": 3, "y": 4}}}
FINGERS = {"0": {"x": 1.0, "y": 2.0}, "1": {"x": 3.0, "y": 4.0}}


@pytest.mark.parametrize(
    ("sent", "used"),
    [
        (
            {"type": "MouseMove", **MOUSE, "shiftKey": True, "buttonLeft": 1, "action": "down"},
            {"type": "MouseMove", **MOUSE, **KEYS, "shiftKey": 1},
        ),
        (
            {"type": "MouseWheel", **MOUSE, "spinY": -1},
            {"type": "MouseWheel", **MOUSE, **KEYS, "spinY": -1.0},
        ),
        (
            {"type": "Tap", **AREA, "position": {"x": 1, "y": 2, "z": 0}},
            {"type": "Tap", **AREA, "position": {"x": 1.0, "y": 2.0}},
        ),
        (
            {"type": "StartPinch", **TOUCH, "factor": 1},
            {"type": "StartPinch", **AREA, "positions": FINGERS, "factor": 1.0},
        ),
        (
            {"type": "Pan", **TOUCH, "translation": [1, -2]},
            {"type": "Pan", **AREA, "positions": FINGERS, "translation": [1.0, -2.0]},
        ),
        (
            {"type": "EndRotate", **TOUCH, "rotation": 30},
            {"type": "EndRotate", **AREA, "positions": FINGERS, "rotation": 30.0},
        ),
        ({"type": "KeyPress", "key": "q"}, None),
        ({"type": "StartInteractionEvent"}, None),
    ],
)
def test_event_is_passed_on_with_the_values_that_it_needs(sent, used):
    assert pointer_event(sent) == used


@pytest.mark.parametrize(
    "event",
    [
        None,
        [],
        {},
        {"type": "ExitEvent"},
        {"type": ["MouseMove"]},
        {"type": "MouseMove"},
        *({"type": "MouseMove", **MOUSE, "x": each} for each in ("a", None, True, [], 1e300)),
        *({"type": "MouseMove", **MOUSE, "w": each} for each in (0, -1, float("nan"), 10**300)),
        {"type": "MouseMove", **MOUSE, "shiftKey": "a"},
        {"type": "MouseMove", **MOUSE, "shiftKey": 1.0},
        {"type": "MouseWheel", **MOUSE},
        {"type": "Tap", **AREA, "position": 7},
        {"type": "Pinch", **AREA, "positions": {}, "factor": 1},
        {"type": "Pinch", **TOUCH, "factor": 0},
        {"type": "Pan", **TOUCH, "translation": [1]},
        {"type": "Rotate", **TOUCH, "rotation": float("inf")},
        {"type": "Rotate", **AREA, "positions": {str(n): {"x": 1, "y": 1} for n in range(11)}},
    ],
)
def test_incomplete_event_is_refused(event):
    with pytest.raises(RefusedError, match="; expected "):
        pointer_event(event)


def test_size_of_the_area():
    assert area_size({"w": 930.25, "h": 519, "videoHeader": 1}) == {"w": 930.25, "h": 519.0, "p": 1}
    for wrong in ({"w": 1e6}, {"h": -1}, {"p": 100}, {"w": "a"}, {"h": None}):
        with pytest.raises(RefusedError):
            area_size({"w": 9, "h": 9, "p": 1, **wrong})
