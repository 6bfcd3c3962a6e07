"""Parameters of another node, asked for in a thread of its own and heard of when they change."""

import threading

from app.bridge import BridgeError, RosNode
from app.bridge.calls import ParameterChange, ParameterClient, ParameterUnsetError
from app.bridge.calls.parameter_values import Plain

_LOOK_AGAIN_S = 0.2
_TIMEOUT_S = 5.0
_CLOSE_S = 5.0
_MOST = 10_000
"""Parameters of one node; what a node tells of beyond them is left out."""


class ParameterWatch:
    """`ask` for a name, `take` what is new: its value, or None for one that is not set.

    Those that were asked for are asked for again when the node has left and come back. Changes of
    any other parameter of the node are told as well.
    """

    def __init__(self, ros: RosNode, node: str) -> None:
        self._ros = ros
        self._client = ParameterClient(ros, node)
        self._condition = threading.Condition()
        self._names: set[str] = set()
        self._asked: set[str] = set()
        self._told: dict[str, int] = {}
        self._new: dict[str, Plain | None] = {}
        self._closing = threading.Event()
        self._client.watch(self._take_change)
        self._thread = threading.Thread(target=self._run, name=f"parameters of {node}", daemon=True)
        self._thread.start()

    @property
    def is_available(self) -> bool:
        """Whether the node serves its parameters now."""
        return self._client.is_available

    def ask(self, name: str) -> None:
        """Have the value of ``name`` from now on."""
        with self._condition:
            self._names.add(name)
            self._asked.add(name)
            self._condition.notify()

    def forget(self, name: str) -> None:
        """Ask for it no more."""
        with self._condition:
            self._names.discard(name)
            self._asked.discard(name)

    def take(self) -> dict[str, Plain | None]:
        """What is new since the last time."""
        with self._condition:
            new, self._new = self._new, {}
        return new

    def close(self) -> None:
        """Stop asking and leave the graph."""
        self._closing.set()
        with self._condition:
            self._condition.notify()
        self._thread.join(_CLOSE_S)
        self._ros.call(self._client.close)

    def _take_change(self, change: ParameterChange) -> None:
        for name, value in {**change.values, **dict.fromkeys(change.deleted)}.items():
            with self._condition:
                if name in self._told or len(self._told) < _MOST:
                    self._told[name] = self._told.get(name, 0) + 1
                    self._new[name] = value

    def _run(self) -> None:
        was_there = False
        while not self._closing.is_set():
            with self._condition:
                if not (self._asked and was_there) and not self._closing.is_set():
                    self._condition.wait(_LOOK_AGAIN_S)
                asked = set(self._asked)
            is_available = self._client.is_available
            if is_available and not was_there:
                with self._condition:
                    asked = set(self._names)
            was_there = is_available and self._get(asked)

    def _get(self, names: set[str]) -> bool:
        """Ask for ``names``; False when the node did not answer."""
        for name in names:
            with self._condition:
                told = self._told.get(name, 0)
            value: Plain | None = None
            try:
                value = self._client.get(name, _TIMEOUT_S, self._closing)
            except ParameterUnsetError:
                value = None
            except (
                BridgeError
            ):  # it left, hangs, says what is no value, or we are closing: asked again
                return False
            with self._condition:
                self._asked.discard(name)
                # A change that came meanwhile is newer than the answer.
                if name in self._names and self._told.get(name, 0) == told:
                    self._new[name] = value
        return True
