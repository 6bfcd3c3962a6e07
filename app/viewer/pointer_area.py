"""The picture's area, whose pointer may grip what it points at instead of moving the camera."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from app.geometry import FloatArray
from app.viewer.messages.events import Event
from app.viewer.messages.methods import Area


class PointerPart(Protocol):
    """A part of the page that takes pointer events."""

    def take(self, page: str, event: Event, /) -> bool:
        """Process an event of ``page``; False if it is for others."""

    def gone(self, page: str, /) -> None:
        """Let go of what ``page`` holds: it is closed."""


class PointerArea:
    """`Area` that gives each event to the first of ``parts`` that takes it, else to ``area``."""

    def __init__(self, area: Area, parts: Sequence[PointerPart]) -> None:
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
