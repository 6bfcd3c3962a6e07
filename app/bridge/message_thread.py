"""Delivers the messages and events of a node's subscriptions in a thread of its own.

rclpy builds a wait set of everything that a node has for each message, and so spends more on its
wait than on the message; with Fast DDS a wait for the events of a subscription ends at each of its
messages, too. Here the middleware itself writes to an eventfd when something has come, by
``eventfd_write`` of the C library as its callback: it waits for no interpreter.
"""

import ctypes
import os
import select
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from itertools import islice
from typing import Any, NamedTuple

from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.executors import (
    ConditionReachedException,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.subscription import Subscription

from app.bridge import message_origin
from app.bridge.message_origin import MessageTaker, Origin, Receiver
from app.bridge.ros_errors import BridgeError

_MAX_TAKEN = 64
"""Messages of one subscription in a turn; the callbacks of others get theirs meanwhile."""


class _Source(NamedTuple):
    """Source of news: ``call_on_news(address, function, data)`` sets its callback in C."""

    handle: Any
    call_on_news: Callable[[int, int | None, int | None], None]
    deliver: Callable[[], None]


class MessageThread:
    """One callback at a time holds ``turn``, of this thread and of the node's executor.

    Those of `poll` do not. ``failed()`` is called while an exception of a callback is handled.
    Without the functions of rcl it delivers nothing, and the executor does.
    """

    def __init__(self, name: str, turn: threading.RLock, failed: Callable[[], None]) -> None:
        self._turn, self._failed = turn, failed
        self._rcl = message_origin.loaded_rcl()
        self._sources: dict[int, _Source] = {}
        self._descriptors: dict[Subscription, list[int]] = {}
        self._polled: dict[Subscription, Callable[[], None]] = {}
        self._polling = threading.Lock()
        self._handlers: set[EventHandler] = set()
        self._ready = select.epoll()
        self._end = self._descriptor()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def is_current(self) -> bool:
        """True in a callback of this thread."""
        return threading.current_thread() is self._thread

    def delivers(self, entity: object) -> bool:
        """True for a subscription that is `add`-ed here, also before it is, and for its events."""
        if self._rcl is None:
            return False
        if isinstance(entity, Subscription):
            return isinstance(entity.callback, Receiver)
        return entity in self._handlers

    def add(self, subscription: Subscription, *, polled: bool = False) -> None:
        """Deliver what comes for ``subscription``, whose callback is a `Receiver`.

        With ``polled`` only its events; `poll` delivers its messages.
        """
        rcl = self._rcl
        if rcl is None:
            return
        with self._turn:
            taker = MessageTaker(rcl)
            deliver = partial(self._deliver, subscription, taker)
            self._descriptors[subscription] = []
            if polled:
                self._polled[subscription] = deliver
            else:
                source = _Source(subscription.handle, rcl.call_on_message, deliver)
                self._watch(subscription, source)
            handlers: Any = subscription.event_handlers  # rclpy annotates it as one
            for handler in handlers:
                event, tell = handler._EventHandler__event, partial(_tell, handler)
                with suppress(BridgeError):  # a middleware that cannot: the executor waits for it
                    self._watch(subscription, _Source(event, rcl.call_on_event, tell))
                    self._handlers.add(handler)

    def poll(self, subscription: Subscription) -> None:
        """Deliver in this thread what has come for ``subscription``, which was added as polled.

        Waits for no callback of the node: the caller may hold a lock that one waits for.
        """
        with self._polling:
            deliver = self._polled.get(subscription)
            if deliver is not None:
                deliver()

    def remove(self, subscription: Subscription) -> None:
        """Deliver no more of ``subscription``; nothing for one that was not added."""
        with self._turn:
            with self._polling:
                self._polled.pop(subscription, None)
            for descriptor in self._descriptors.pop(subscription, ()):
                source = self._sources.pop(descriptor)
                with suppress(InvalidHandle), source.handle:
                    source.call_on_news(source.handle.pointer, None, None)
                self._ready.unregister(descriptor)
                os.close(descriptor)
            handlers: Any = subscription.event_handlers
            self._handlers.difference_update(handlers)

    def close(self, timeout_s: float) -> None:
        """End the thread and deliver nothing more. A callback that does not return keeps both."""
        os.eventfd_write(self._end, 1)
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            return
        for subscription in list(self._descriptors):
            self.remove(subscription)
        self._ready.close()
        os.close(self._end)

    def _watch(self, subscription: Subscription, source: _Source) -> None:
        descriptor = self._descriptor()
        self._sources[descriptor] = source
        self._descriptors[subscription].append(descriptor)
        with source.handle:  # also what waits already writes to the descriptor
            source.call_on_news(source.handle.pointer, _WRITE, descriptor)

    def _descriptor(self) -> int:
        descriptor = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        self._ready.register(descriptor, select.EPOLLIN)
        return descriptor

    def _run(self) -> None:
        while True:
            for descriptor, _ in self._ready.poll():
                if descriptor == self._end:
                    return
                with self._turn:
                    self._take_turn(descriptor)

    def _take_turn(self, descriptor: int) -> None:
        source = self._sources.get(descriptor)
        if source is None:  # removed after the wait
            return
        with suppress(BlockingIOError):
            os.eventfd_read(descriptor)
        try:
            source.deliver()
        except Exception:
            self._failed()

    def _deliver(self, subscription: Subscription, taker: MessageTaker) -> None:
        receiver: Any = subscription.callback
        with subscription.handle:
            take = partial(taker.take, subscription.handle.pointer)
            taken: list[tuple[bytes, Origin]] = list(islice(iter(take, None), _MAX_TAKEN))
        if len(taken) == _MAX_TAKEN and subscription not in self._polled:
            os.eventfd_write(self._descriptors[subscription][0], 1)  # the rest in the next turn
        for data, origin in taken:
            if subscription not in self._descriptors:  # removed by its own callback
                return
            try:
                receiver.receive(data, origin)
            except Exception:  # the other messages are not lost
                self._failed()


def _tell(handler: Any) -> None:
    """Call the callback of an event, as rclpy's executor does."""
    handler._ready_to_take_data = True
    status = handler.take_data()
    if status is not None:
        handler.callback(status)


class TurnExecutor(SingleThreadedExecutor):
    """Executor whose callbacks hold ``turn``, without what ``messages`` delivers."""

    def __init__(self, turn: threading.RLock, messages: MessageThread, **options: Any) -> None:
        super().__init__(**options)
        self._turn, self._messages = turn, messages

    def can_execute(self, entity: Any) -> bool:
        """True for an entity to wait for."""
        return not self._messages.delivers(entity) and super().can_execute(entity)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait as rclpy does, and call with ``turn``."""
        try:
            handler, _, _ = self.wait_for_ready_callbacks(timeout_sec, None, _never)
        except (ShutdownException, TimeoutException, ConditionReachedException):
            return
        with self._turn:
            handler()
        problem = handler.exception()
        if problem is not None:
            raise problem
        handler.result()


def _never() -> bool:
    """One object: rclpy drops what is ready when it is called with another condition."""
    return False


_WRITE = ctypes.cast(ctypes.CDLL(None).eventfd_write, ctypes.c_void_p).value
"""Address of ``int eventfd_write(int fd, eventfd_t value)``. rcl calls it as its callback with the
descriptor as ``const void * user_data`` and the ``size_t`` number of new messages."""
