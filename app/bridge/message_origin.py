"""Identity of the publisher that has sent a message.

rclpy passes the times and the sequence number of a message to a callback, and not the identifier
(GID) of its publisher, although the middleware delivers it. It is read here with the C functions of
the rcl library that rclpy has loaded. The identifier is that of
``TopicEndpointInfo.endpoint_gid`` with Fast DDS; Cyclone DDS has its own, which is unique, too.
"""

import ctypes
import os
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from rclpy.publisher import Publisher

from app.bridge.ros_errors import BridgeError

_TAKE_FAILED = 401
"""``RCL_RET_SUBSCRIPTION_TAKE_FAILED``: no message is there."""

_GID_BYTES = 16
"""``RMW_GID_STORAGE_SIZE`` since ROS 2 Iron."""

_INFO = struct.Struct(f"@qqQQP{_GID_BYTES}s")
"""``rmw_message_info_t`` of ROS 2 Jazzy: time of the source and of the receipt, number of the
publication and of the reception, address of the middleware's name, identifier of the publisher."""

_INFO_BYTES = 512
"""Room for a longer one."""

_MAX_KEPT_BYTES = 1 << 20
"""A larger buffer of a subscription is released after its message."""

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


class Rcl:
    """The functions of the loaded libraries; raises `OSError` or `AttributeError` without them."""

    def __init__(self) -> None:
        # The interpreter lock is kept, as rclpy does: a busy thread would delay its return.
        loaded = os.RTLD_NOLOAD | os.RTLD_NOW
        rcl = ctypes.PyDLL("librcl.so", mode=loaded)
        self.take = rcl.rcl_take_serialized_message
        self.take.argtypes = (ctypes.c_void_p,) * 4
        self.reset_error = rcl.rcutils_reset_error
        self._on_message = rcl.rcl_subscription_set_on_new_message_callback
        self._on_event = rcl.rcl_event_set_callback
        self._on_message.argtypes = self._on_event.argtypes = (ctypes.c_void_p,) * 3
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

    def call_on_message(self, address: int, function: int | None, data: int | None) -> None:
        """Have the middleware call ``function(data, count)`` for new messages; None: no more.

        ``address`` is that of the ``rcl_subscription_t``.
        """
        self._require_ok(self._on_message(address, function, data))

    def call_on_event(self, address: int, function: int | None, data: int | None) -> None:
        """The same as `call_on_message` for the ``rcl_event_t`` at ``address``."""
        self._require_ok(self._on_event(address, function, data))

    def _require_ok(self, result: int) -> None:
        if result != 0:
            self.reset_error()
            raise BridgeError(f"subscription: rcl cannot tell what comes (error {result})")


@cache
def loaded_rcl() -> Rcl | None:
    """The functions that rclpy has loaded; None where they are not those of ROS 2 Jazzy."""
    try:
        return Rcl()
    except (OSError, AttributeError):  # another build of ROS, or another operating system
        return None


def sender_of(publisher: Publisher) -> bytes | None:
    """Identity of our own ``publisher``, as in `Origin`; None if it cannot be determined."""
    rcl, gid = loaded_rcl(), _Gid()
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

    def __init__(self, rcl: Rcl) -> None:
        self._rcl = rcl
        self._info = ctypes.create_string_buffer(_INFO_BYTES)
        self._bytes = _Bytes()
        self._places = (ctypes.byref(self._bytes), ctypes.byref(self._info), None)
        self._init_bytes()

    def take(self, subscription: int) -> tuple[bytes, Origin] | None:
        """The next message of the ``rcl_subscription_t`` at this address; None without one."""
        result = self._rcl.take(subscription, *self._places)
        if result != 0:
            self._rcl.reset_error()
            if result == _TAKE_FAILED:
                return None
            raise BridgeError(f"subscription: rcl cannot take a message (error {result})")
        data = ctypes.string_at(self._bytes.buffer, self._bytes.length)
        if self._bytes.capacity > _MAX_KEPT_BYTES:
            self._rcl.free_bytes(ctypes.byref(self._bytes))
            self._init_bytes()
        published_ns, received_ns, number, _, name, gid = _INFO.unpack_from(self._info)
        # The address of the middleware's name shows that the structure is the expected one.
        sender = gid if name == self._rcl.implementation else None
        return data, Origin(sender, _sequence(number), published_ns, received_ns)

    def _init_bytes(self) -> None:
        allocator = self._rcl.default_allocator()
        if self._rcl.init_bytes(ctypes.byref(self._bytes), 0, ctypes.byref(allocator)) != 0:
            raise BridgeError("buffer of a subscription: out of memory")

    def __del__(self) -> None:
        self._rcl.free_bytes(ctypes.byref(self._bytes))


@dataclass(frozen=True, slots=True)
class Receiver:
    """Callback of a raw subscription that passes each message and its origin to ``receive``.

    `MessageThread` calls ``receive`` itself. Without it rclpy calls this object, and the sender is
    not known.
    """

    receive: ReceiveFrom

    def __call__(self, data: bytes, info: Mapping[str, int]) -> None:
        """Receive a message with the number and the times that rclpy gives."""
        number = _sequence(info["publication_sequence_number"])
        origin = Origin(None, number, info["source_timestamp"], info["received_timestamp"])
        self.receive(data, origin)


def _sequence(number: int) -> int | None:
    return None if number == _UNSUPPORTED else number
