"""The events of a node's publishers and subscriptions as one waitable."""

import time
from collections.abc import Sequence
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import EventHandler
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from rclpy.waitable import NumberOfEntities, Waitable

from app.geometry import NS_PER_S

INTERVAL_S = 0.02
"""A node that is woken more often than this looks at its events once in it: they come as late."""


class EndpointEvents(Waitable):
    """Waits for the events of many endpoints of ``node`` together.

    rclpy builds its wait set anew for each message, and spends more on the two or three events of
    each endpoint than on everything else. So a node waits for them every `INTERVAL_S` only, and
    a timer ends a wait without them. Call every method in the node's thread, or while nothing
    spins the node.
    """

    def __init__(self, node: Node) -> None:
        super().__init__(node.default_callback_group)  # type: ignore[no-untyped-call]
        self._node = node
        self._handlers: tuple[EventHandler, ...] = ()
        self._waiting: tuple[EventHandler, ...] = ()
        self._ready: list[EventHandler] = []
        self._waited_ns = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(INTERVAL_S, lambda: None, clock=steady)
        node.add_waitable(self)

    def collect(self) -> None:
        """Take over the events of all endpoints that the node has now."""
        found = [each for each in self._node.waitables if isinstance(each, EventHandler)]
        for handler in found:
            self._node.remove_waitable(handler)
            handler.__enter__()  # until `release`, and not anew for each wait
        self._handlers += tuple(found)

    def release(self, endpoint: Publisher | Subscription | None = None) -> None:
        """Give the events of ``endpoint``, or all, back to the node, which can then destroy it."""
        # rclpy annotates the list as if it were one handler.
        released: Any = self._handlers if endpoint is None else endpoint.event_handlers
        for handler in released:
            if handler in self._handlers:
                handler.__exit__(None, None, None)
                self._node.add_waitable(handler)
        self._handlers = tuple(each for each in self._handlers if each not in released)

    def __enter__(self) -> None:
        # The executor counts, adds and checks the same events afterwards.
        now_ns = time.monotonic_ns()
        if now_ns - self._waited_ns < INTERVAL_S * NS_PER_S:
            self._waiting = ()
            if self._timer.is_canceled():
                self._timer.reset()
        else:
            self._waiting, self._waited_ns = self._handlers, now_ns
            self._timer.cancel()

    def __exit__(self, *raised: Any) -> None:
        pass

    def get_num_entities(self) -> NumberOfEntities:
        """Number of events."""
        return NumberOfEntities(num_events=len(self._waiting))

    def add_to_wait_set(self, wait_set: Any) -> None:
        """Add all events."""
        for handler in self._waiting:
            handler.add_to_wait_set(wait_set)

    def is_ready(self, wait_set: Any) -> bool:
        """True if an event has happened."""
        self._ready = [each for each in self._waiting if each.is_ready(wait_set)]
        return bool(self._ready)

    def take_data(self) -> list[tuple[EventHandler, Any]]:
        """The events that have happened."""
        return [(handler, handler.take_data()) for handler in self._ready]

    async def execute(self, taken_data: Sequence[tuple[EventHandler, Any]]) -> None:
        """Call the callbacks of the events; one that raises does not stop the others."""
        failed = None
        for handler, data in taken_data:
            try:
                await handler.execute(data)
            except Exception as error:
                failed = error
        if failed is not None:
            raise failed
