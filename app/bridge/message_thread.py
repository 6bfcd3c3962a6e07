"""Delivers the messages of a node's subscriptions, each with its origin, in a thread of its own.

rclpy builds a wait set of everything that a node has for each message, and so spends more on its
wait than on the message. Here the middleware itself writes to an eventfd when a message has come,
by ``eventfd_write`` of the C library as its callback: it waits for no interpreter.
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

from rclpy.exceptions import InvalidHandle
from rclpy.executors import (
    ConditionReachedException,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.subscription import Subscription

from app.bridge import message_origin
from app.bridge.message_origin import MessageTaker, Origin, Rcl, ReceiveFrom, Receiver

_MAX_TAKEN = 64
"""Messages of one subscription in a turn; the callbacks of others get theirs meanwhile."""


class _Input(NamedTuple):
    subscription: Subscription
    receive: ReceiveFrom
    taker: MessageTaker


class MessageThread:
    """One callback at a time holds ``turn``, of the messages and of the node's executor.

    ``failed()`` is called while an exception of a callback is handled. Without the functions of rcl
    it delivers nothing, and the executor does.
    """

    def __init__(self, name: str, turn: threading.RLock, failed: Callable[[], None]) -> None:
        self._turn, self._failed = turn, failed
        self._rcl = message_origin.loaded_rcl()
        self._inputs: dict[int, _Input] = {}
        self._descriptors: dict[Subscription, int] = {}
        self._ready = select.epoll()
        self._end = self._descriptor()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def is_current(self) -> bool:
        """True in a callback of a message."""
        return threading.current_thread() is self._thread

    def delivers(self, entity: object) -> bool:
        """True for a subscription that is `add`-ed here, also before it is."""
        if self._rcl is None or not isinstance(entity, Subscription):
            return False
        return isinstance(entity.callback, Receiver)

    def add(self, subscription: Subscription) -> None:
        """Deliver the messages of ``subscription`` to its callback, which is a `Receiver`."""
        receiver: Any = subscription.callback
        if self._rcl is None:
            return
        with self._turn:
            descriptor = self._descriptor()
            self._inputs[descriptor] = _Input(
                subscription, receiver.receive, MessageTaker(self._rcl)
            )
            self._descriptors[subscription] = descriptor
            self._wake_by(self._rcl, subscription, descriptor)

    def remove(self, subscription: Subscription) -> None:
        """Deliver no more messages of ``subscription``; nothing for one that was not added."""
        with self._turn:
            descriptor = self._descriptors.pop(subscription, None)
            if descriptor is None or self._rcl is None:
                return
            del self._inputs[descriptor]
            with suppress(InvalidHandle):
                self._wake_by(self._rcl, subscription, None)
            self._ready.unregister(descriptor)
            os.close(descriptor)

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

    def _descriptor(self) -> int:
        descriptor = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        self._ready.register(descriptor, select.EPOLLIN)
        return descriptor

    def _wake_by(self, rcl: Rcl, subscription: Subscription, descriptor: int | None) -> None:
        """Write to ``descriptor`` at each message, also for those that wait already."""
        with subscription.handle:
            rcl.call_on_message(
                subscription.handle.pointer, None if descriptor is None else _WRITE, descriptor
            )

    def _run(self) -> None:
        while True:
            for descriptor, _ in self._ready.poll():
                if descriptor == self._end:
                    return
                with self._turn:
                    self._deliver(descriptor)

    def _deliver(self, descriptor: int) -> None:
        found = self._inputs.get(descriptor)
        if found is None:  # removed after the wait
            return
        with suppress(BlockingIOError):
            os.eventfd_read(descriptor)
        taken: list[tuple[bytes, Origin]] = []
        try:
            with found.subscription.handle:
                take = partial(found.taker.take, found.subscription.handle.pointer)
                taken += islice(iter(take, None), _MAX_TAKEN)
        except Exception:
            self._failed()
        if len(taken) == _MAX_TAKEN:
            os.eventfd_write(descriptor, 1)  # the rest in the next turn
        for data, origin in taken:
            if self._inputs.get(descriptor) is not found:  # removed by its own callback
                return
            try:
                found.receive(data, origin)
            except Exception:  # the other messages are not lost
                self._failed()


class TurnExecutor(SingleThreadedExecutor):
    """Executor whose callbacks hold ``turn``, without the subscriptions of ``messages``."""

    def __init__(self, turn: threading.RLock, messages: MessageThread, **options: Any) -> None:
        super().__init__(**options)
        self._turn, self._messages = turn, messages

    def can_execute(self, entity: Any) -> bool:
        """True for an entity to wait for."""
        return not self._messages.delivers(entity) and super().can_execute(entity)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """As that of rclpy, with ``turn``."""
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
    return False


_WRITE = ctypes.cast(ctypes.CDLL(None).eventfd_write, ctypes.c_void_p).value
"""Address of ``int eventfd_write(int fd, eventfd_t value)``. rcl calls it as its callback with the
descriptor as ``const void * user_data`` and the ``size_t`` number of new messages."""
