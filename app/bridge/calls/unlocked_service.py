"""Receive the requests of a service without the interpreter lock (GIL).

rclpy holds the lock while the middleware deserialises a request: 9 to 15 ms for 7 MB. Here rcl is
called through ctypes, which releases it, so that other threads keep running.
"""

import ctypes
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.type_support import check_for_type_support

from app.bridge.errors import BridgeError

_OK, _NOTHING_TAKEN = 0, 601  # RCL_RET_OK, RCL_RET_SERVICE_TAKE_FAILED


class _RequestId(ctypes.Structure):
    """``rmw_request_id_t``."""

    _fields_ = [("writer_guid", ctypes.c_uint8 * 16), ("sequence_number", ctypes.c_int64)]


# Both are loaded already, as libraries that rclpy needs.
_rcl, _rcutils = ctypes.CDLL("librcl.so"), ctypes.CDLL("librcutils.so")
for _function in (_rcl.rcl_take_request, _rcl.rcl_send_response):
    _function.argtypes = [ctypes.c_void_p, ctypes.POINTER(_RequestId), ctypes.c_void_p]

_address = ctypes.pythonapi.PyCapsule_GetPointer
_address.argtypes, _address.restype = [ctypes.py_object, ctypes.c_char_p], ctypes.c_void_p

_Create = ctypes.PYFUNCTYPE(ctypes.c_void_p)
_Destroy = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)
_ToPython = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)
_FromPython = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.py_object, ctypes.c_void_p)


class _Message:
    """A C message of a generated type, in a ``with`` statement."""

    def __init__(self, kind: type) -> None:
        self._support: Any = type(kind)
        self.address: int = 0

    def __enter__(self) -> "_Message":
        self.address = _Create(_address(self._support._CREATE_ROS_MESSAGE, None))()
        return self

    def __exit__(self, *_: object) -> None:
        _Destroy(_address(self._support._DESTROY_ROS_MESSAGE, None))(self.address)

    def to_python(self) -> Any:
        return _ToPython(_address(self._support._CONVERT_TO_PY, None))(self.address)

    def fill(self, value: object) -> None:
        if not _FromPython(_address(self._support._CONVERT_FROM_PY, None))(value, self.address):
            raise BridgeError(f"{value!r} cannot be converted; expected a valid message")


class _UnlockedHandle(rclpy_implementation.Service):  # type: ignore[misc]  # of pybind11
    """A service of rclpy that takes requests and sends responses without the lock."""

    def service_take_request(self, kind: type) -> tuple[Any, _RequestId | None]:
        """A request and its id; None for both if there is none."""
        header = _RequestId()
        with _Message(kind) as message:
            code = _rcl.rcl_take_request(self.pointer, ctypes.byref(header), message.address)
            if code == _NOTHING_TAKEN:
                _rcutils.rcutils_reset_error()
                return None, None
            _require_ok(code, "a request cannot be received")
            return message.to_python(), header


class _UnlockedService(Service):
    """A service that sends its responses through an `_UnlockedHandle`."""

    def send_response(self, response: object, header: _RequestId) -> None:
        with self.handle, _Message(type(response)) as message:
            message.fill(response)
            code = _rcl.rcl_send_response(
                self.handle.pointer, ctypes.byref(header), message.address
            )
            _require_ok(code, "a response cannot be sent")


def create_unlocked_service(
    node: Node,
    kind: Any,
    name: str,
    callback: Callable[[Any, Any], Any],
    *,
    received_as: type,
    qos_profile: QoSProfile,
    callback_group: CallbackGroup | None,
) -> Service:
    """Create a service like ``node.create_service``, for requests received as ``received_as``.

    That is a type with the type support of the request and another conversion to Python.
    """
    check_for_type_support(kind)
    with node.handle:
        handle = _UnlockedHandle(node.handle, kind, name, qos_profile.get_c_qos_profile())
    types = type("SrvType", (), {"Request": received_as, "Response": kind.Response})
    group = callback_group or node.default_callback_group
    service = _UnlockedService(handle, types, name, callback, group, qos_profile)
    # The rest of `Node.create_service`, which has no parameter for the class of the service.
    group.add_entity(service)
    node._services.append(service)
    node._wake_executor()
    return service


def _require_ok(code: int, what: str) -> None:
    if code != _OK:
        _rcutils.rcutils_reset_error()
        raise BridgeError(f"{what}: rcl returned {code}; expected 0")
