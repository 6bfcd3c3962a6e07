"""Identity of the publisher that has sent a message.

rclpy passes the times and the sequence number of a message to a callback, and not the identifier
(GID) of its publisher, although the middleware delivers it. It is read here with the C functions of
the rcl library that rclpy has loaded. The identifier is that of
``TopicEndpointInfo.endpoint_gid`` with Fast DDS; Cyclone DDS has its own, which is unique, too.
"""

import ctypes
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from itertools import islice
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from app.bridge.errors import BridgeError

_TAKE_FAILED = 401
"""``RCL_RET_SUBSCRIPTION_TAKE_FAILED``: no message is there."""

_GID_BYTES = 16
"""``RMW_GID_STORAGE_SIZE`` since ROS 2 Iron."""

_MAX_KEPT_BYTES = 1 << 20
"""A larger buffer of a subscription is released after its message."""

_MAX_TAKEN = 64
"""Messages of one subscription in a turn of the executor. To wait for the next turn costs more than
a message, since rclpy builds its wait set anew; other callbacks get their turn meanwhile."""

_UNSUPPORTED = 2**64 - 1
"""``RMW_MESSAGE_INFO_SEQUENCE_NUMBER_UNSUPPORTED``."""


class Origin(NamedTuple):
    """Where a message comes from.

    ``sender`` identifies the publisher; None if the middleware's interface is another one than
    that of ROS 2 Jazzy. ``sequence`` is the number of the message at its publisher; None with
    Cyclone DDS. ``published_ns`` and ``received_ns`` are the middleware's times in ns since 1970, 0
    where it gives none.
    """

    sender: bytes | None
    sequence: int | None
    published_ns: int = 0
    received_ns: int = 0


ReceiveFrom = Callable[[bytes, Origin], None]
"""Receives the bytes of a message and its origin."""


class _Allocator(ctypes.Structure):
    _fields_ = tuple(
        (name, ctypes.c_void_p)
        for name in ("allocate", "deallocate", "reallocate", "zero_allocate", "state")
    )


class _Bytes(ctypes.Structure):
    _fields_ = (
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    )


class _Gid(ctypes.Structure):
    """``rmw_gid_t`` of ROS 2 Jazzy, with room for a longer one."""

    _fields_ = (
        ("implementation", ctypes.c_void_p),
        ("data", ctypes.c_uint8 * _GID_BYTES),
        ("rest", ctypes.c_uint8 * 64),
    )


class _Info(ctypes.Structure):
    """``rmw_message_info_t`` of ROS 2 Jazzy, with room for a longer one."""

    _fields_ = (
        ("source_timestamp", ctypes.c_int64),
        ("received_timestamp", ctypes.c_int64),
        ("publication_sequence_number", ctypes.c_uint64),
        ("reception_sequence_number", ctypes.c_uint64),
        ("implementation", ctypes.c_void_p),
        ("gid", ctypes.c_uint8 * _GID_BYTES),
        ("rest", ctypes.c_uint8 * 256),
    )


class _Rcl:
    """The functions of the loaded libraries; raises `OSError` or `AttributeError` without them."""

    def __init__(self) -> None:
        # The interpreter lock is kept, as rclpy does: a busy thread would delay its return.
        loaded = os.RTLD_NOLOAD | os.RTLD_NOW
        rcl = ctypes.PyDLL("librcl.so", mode=loaded)
        self.take = rcl.rcl_take_serialized_message
        self.take.argtypes = (ctypes.c_void_p,) * 4
        self.reset_error = rcl.rcutils_reset_error
        self.init_bytes = rcl.rcutils_uint8_array_init
        self.init_bytes.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p)
        self.free_bytes = rcl.rcutils_uint8_array_fini
        self.free_bytes.argtypes = (ctypes.c_void_p,)
        self.default_allocator = rcl.rcutils_get_default_allocator
        self.default_allocator.restype = _Allocator
        self.rmw_publisher = rcl.rcl_publisher_get_rmw_handle
        self.rmw_publisher.argtypes = (ctypes.c_void_p,)
        self.rmw_publisher.restype = ctypes.c_void_p
        self.gid_of_publisher = rcl.rmw_get_gid_for_publisher
        self.gid_of_publisher.argtypes = (ctypes.c_void_p,) * 2
        rcl.rmw_get_implementation_identifier.restype = ctypes.c_void_p
        self.implementation = rcl.rmw_get_implementation_identifier()


@cache
def _loaded_rcl() -> _Rcl | None:
    try:
        return _Rcl()
    except (OSError, AttributeError):  # another build of ROS, or another operating system
        return None


def sender_of(publisher: Publisher) -> bytes | None:
    """Identity of our own ``publisher``, as in `Origin`; None if it cannot be determined."""
    rcl, gid = _loaded_rcl(), _Gid()
    if rcl is None:
        return None
    with publisher.handle:
        address = rcl.rmw_publisher(publisher.handle.pointer)
        if not address or rcl.gid_of_publisher(address, ctypes.byref(gid)) != 0:
            rcl.reset_error()
            return None
    return bytes(gid.data) if gid.implementation == rcl.implementation else None


class MessageTaker:
    """Takes messages of one subscription with their origin. For one thread at a time."""

    def __init__(self, rcl: _Rcl) -> None:
        self._rcl = rcl
        self._info = _Info()
        self._bytes = _Bytes()
        self._init_bytes()

    def take(self, subscription: int) -> tuple[bytes, Origin] | None:
        """The next message of the ``rcl_subscription_t`` at this address; None without one."""
        result = self._rcl.take(
            subscription, ctypes.byref(self._bytes), ctypes.byref(self._info), None
        )
        if result != 0:
            self._rcl.reset_error()
            if result == _TAKE_FAILED:
                return None
            raise BridgeError(f"subscription: rcl cannot take a message (error {result})")
        data = ctypes.string_at(self._bytes.buffer, self._bytes.length)
        if self._bytes.capacity > _MAX_KEPT_BYTES:
            self._rcl.free_bytes(ctypes.byref(self._bytes))
            self._init_bytes()
        # The address of the middleware's name shows that the structure is the expected one.
        is_known = self._info.implementation == self._rcl.implementation
        return data, Origin(
            bytes(self._info.gid) if is_known else None,
            _sequence(self._info.publication_sequence_number),
            self._info.source_timestamp,
            self._info.received_timestamp,
        )

    def _init_bytes(self) -> None:
        allocator = self._rcl.default_allocator()
        if self._rcl.init_bytes(ctypes.byref(self._bytes), 0, ctypes.byref(allocator)) != 0:
            raise BridgeError("buffer of a subscription: out of memory")

    def __del__(self) -> None:
        self._rcl.free_bytes(ctypes.byref(self._bytes))


@dataclass(frozen=True, slots=True)
class Receiver:
    """Callback of a raw subscription that passes each message and its origin to ``receive``.

    `OriginExecutor` calls ``receive`` itself. Without the sender, rclpy calls this object.
    """

    receive: ReceiveFrom

    def __call__(self, data: bytes, info: Mapping[str, int]) -> None:
        """Receive a message with the number and the times that rclpy gives."""
        number = _sequence(info["publication_sequence_number"])
        origin = Origin(None, number, info["source_timestamp"], info["received_timestamp"])
        self.receive(data, origin)


class OriginExecutor(SingleThreadedExecutor):
    """Executor that passes the origin of each message to the subscriptions of `add_receiver`."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._takers: WeakKeyDictionary[Subscription, MessageTaker] = WeakKeyDictionary()

    def add_receiver(self, subscription: Subscription) -> None:
        """Take the messages of ``subscription``, whose callback is a `Receiver`, with origin."""
        rcl = _loaded_rcl()
        if rcl is not None:
            self._takers[subscription] = MessageTaker(rcl)

    def _make_handler(self, entity: Any, node: Any, take_from_wait_list: Any) -> Any:
        """For a receiver not a task: rclpy wakes itself twice for each, to build two wait sets."""
        taker = self._takers.get(entity) if isinstance(entity, Subscription) else None
        if taker is None:
            return super()._make_handler(entity, node, take_from_wait_list)
        return _Delivery(taker, entity)


class _Delivery:
    """Passes the waiting messages of ``subscription`` to its `Receiver`, as a task of rclpy."""

    __slots__ = ("_failed", "_subscription", "_taker")

    def __init__(self, taker: MessageTaker, subscription: Subscription) -> None:
        self._taker, self._subscription = taker, subscription
        self._failed: Exception | None = None

    def __call__(self) -> None:
        with suppress(InvalidHandle):  # it has been destroyed, perhaps in its own callback
            with self._subscription.handle:
                address = self._subscription.handle.pointer
                take = partial(self._taker.take, address)
                taken = list(islice(iter(take, None), _MAX_TAKEN))
            for data, origin in taken:
                with self._subscription.handle:
                    pass
                try:
                    self._subscription.callback.receive(data, origin)
                except Exception as error:  # the other messages are not lost
                    self._failed = error

    def exception(self) -> Exception | None:
        return self._failed

    def result(self) -> None:
        """Nothing is returned."""


def _sequence(number: int) -> int | None:
    return None if number == _UNSUPPORTED else number
