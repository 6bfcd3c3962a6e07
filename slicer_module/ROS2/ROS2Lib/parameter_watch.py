"""Watches parameters of another node: requests values in a thread and listens for changes."""

import threading
from collections.abc import Callable

from app.bridge import BridgeError, RosNode
from app.bridge.calls import ParameterChange, ParameterClient, ParameterUnsetError
from app.bridge.calls.parameter_server import Plain

_POLL_S = 0.2
_TIMEOUT_S = 5.0
_CLOSE_TIMEOUT_S = 5.0
_MAX_PARAMETERS = 10_000
"""Most parameters of one node; changes of further ones are ignored."""


class ParameterWatch:
    """`add` a name, then `take` new values; the value is None for a parameter that is not set.

    All names are requested again when the node returns after it was gone. Changes of the node's
    other parameters are returned as well. ``changed()`` is called in another thread when there are
    new values.
    """

    def __init__(self, ros: RosNode, node: str, changed: Callable[[], None]) -> None:
        self._ros = ros
        self._changed = changed
        self._client = ParameterClient(ros, node)
        self._condition = threading.Condition()
        self._names: set[str] = set()
        self._unanswered: set[str] = set()
        self._change_counts: dict[str, int] = {}
        self._new: dict[str, Plain | None] = {}
        self._closing = threading.Event()
        self._client.watch(self._take_change)
        self._thread = threading.Thread(target=self._run, name=f"parameters of {node}", daemon=True)
        self._thread.start()

    @property
    def is_available(self) -> bool:
        """True while the node serves its parameters."""
        return self._client.is_available

    def add(self, name: str) -> None:
        """Request the value of ``name``."""
        with self._condition:
            self._names.add(name)
            self._unanswered.add(name)
            self._condition.notify()

    def remove(self, name: str) -> None:
        """Stop requesting ``name``."""
        with self._condition:
            self._names.discard(name)
            self._unanswered.discard(name)

    def take(self) -> dict[str, Plain | None]:
        """New values since the last call."""
        with self._condition:
            new, self._new = self._new, {}
        return new

    def close(self) -> None:
        """Stop the thread and leave the graph."""
        self._closing.set()
        with self._condition:
            self._condition.notify()
        self._thread.join(_CLOSE_TIMEOUT_S)
        self._ros.call(self._client.close)

    def _take_change(self, change: ParameterChange) -> None:
        for name, value in {**change.values, **dict.fromkeys(change.deleted)}.items():
            with self._condition:
                if name in self._change_counts or len(self._change_counts) < _MAX_PARAMETERS:
                    self._change_counts[name] = self._change_counts.get(name, 0) + 1
                    self._new[name] = value
        self._changed()

    def _run(self) -> None:
        was_available = False
        while not self._closing.is_set():
            with self._condition:
                if not (self._unanswered and was_available) and not self._closing.is_set():
                    self._condition.wait(_POLL_S)
                requested = set(self._unanswered)
            is_available = self._client.is_available
            if is_available and not was_available:
                with self._condition:
                    requested = set(self._names)
            was_available = is_available and self._get(requested)

    def _get(self, names: set[str]) -> bool:
        """Request ``names``; False if the node did not answer."""
        for name in names:
            with self._condition:
                count = self._change_counts.get(name, 0)
            value: Plain | None = None
            try:
                value = self._client.get(name, _TIMEOUT_S, self._closing)
            except ParameterUnsetError:
                value = None
            except BridgeError:  # gone, no reply, invalid value or closing: requested again
                return False
            with self._condition:
                self._unanswered.discard(name)
                # A change received in the meantime is newer than the answer.
                if name in self._names and self._change_counts.get(name, 0) == count:
                    self._new[name] = value
            self._changed()
        return True
