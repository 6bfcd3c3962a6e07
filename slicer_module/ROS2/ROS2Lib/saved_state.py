"""State of a node of this module in a saved scene, in attributes of the MRML node."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

_CLASS, _KIND, _NAMES, _SETTINGS = "ros2.class", "ros2.kind", "ros2.names", "ros2.settings"


@contextmanager
def without_events(node: Any) -> Iterator[None]:
    """Change ``node`` without ``ModifiedEvent``, which means a message or a response to scripts."""
    before = node.GetDisableModifiedEvent()
    node.SetDisableModifiedEvent(1)
    try:
        yield
    finally:
        node.SetDisableModifiedEvent(before)


@dataclass(frozen=True, slots=True)
class SavedState:
    """Class, kind, names on the ROS graph and settings of a ROS node or of one of its members."""

    family: str
    kind: str
    names: tuple[str, ...]
    settings: dict[str, Any]

    def store(self, node: Any) -> None:
        """Write the attributes of ``node``."""
        with without_events(node):
            node.SetAttribute(_CLASS, self.family)
            node.SetAttribute(_KIND, self.kind)
            node.SetAttribute(_NAMES, json.dumps(self.names))
            node.SetAttribute(_SETTINGS, json.dumps(self.settings))

    @staticmethod
    def forget(node: Any) -> None:
        """Remove the attributes, so that a loaded scene does not create the node again."""
        with without_events(node):
            for name in (_CLASS, _KIND, _NAMES, _SETTINGS):
                node.RemoveAttribute(name)

    @classmethod
    def load(cls, node: Any) -> "SavedState | None":
        """State in the attributes of ``node``; None without one.

        Raises ValueError for attributes of another form.
        """
        family = node.GetAttribute(_CLASS)
        if family is None:
            return None
        names = json.loads(node.GetAttribute(_NAMES) or "[]")
        settings = json.loads(node.GetAttribute(_SETTINGS) or "{}")
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise ValueError(f"{_NAMES} is {names!r}; expected a list of strings")
        if not isinstance(settings, dict):
            raise ValueError(f"{_SETTINGS} is {settings!r}; expected an object")
        return cls(family, node.GetAttribute(_KIND) or "", tuple(names), settings)
