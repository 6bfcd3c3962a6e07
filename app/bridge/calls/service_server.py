"""Service server that replies even when its handler fails."""

import ctypes
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_services_default
from rclpy.serialization import serialize_message
from rclpy.service import Service
from rclpy.task import Future
from rclpy.type_support import check_for_type_support
from std_srvs.srv import Trigger

from app.bridge.convert.plain import service_type
from app.bridge.message_definitions import foreign_clients
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError, CallError, reason_of
from app.geometry import MarginGuardError

_OK, _NOTHING_TAKEN = 0, 601  # RCL_RET_OK, RCL_RET_SERVICE_TAKE_FAILED

# Both are loaded already, as libraries that rclpy needs.
_rcl, _rcutils = ctypes.CDLL("librcl.so"), ctypes.CDLL("librcutils.so")

_address = ctypes.pythonapi.PyCapsule_GetPointer
_address.argtypes, _address.restype = [ctypes.py_object, ctypes.c_char_p], ctypes.c_void_p

_Create = ctypes.PYFUNCTYPE(ctypes.c_void_p)
_Destroy = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)
_ToPython = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)
_FromPython = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.py_object, ctypes.c_void_p)


class _RequestId(ctypes.Structure):
    """``rmw_request_id_t``."""

    _fields_ = [("writer_guid", ctypes.c_uint8 * 16), ("sequence_number", ctypes.c_int64)]


for _function in (_rcl.rcl_take_request, _rcl.rcl_send_response):
    _function.argtypes = [ctypes.c_void_p, ctypes.POINTER(_RequestId), ctypes.c_void_p]


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


def _create_unlocked_service(
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

    That is a type with the type support of the request and another conversion to Python. rclpy
    holds the interpreter lock (GIL) while the middleware deserialises a request: 9 to 15 ms for
    7 MB. Here rcl is called through ctypes, which releases it, so that other threads keep running.
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


class ServiceServer:
    """Serves ``name``: ``handle(request, response)`` fills in the response.

    ``handle`` runs in the node's thread and must not wait for another call. With ``in_thread`` it
    runs in a separate thread, one request at a time; further requests are refused meanwhile. With
    ``lane`` that is so for requests of the same lane.
    ``check(request)`` runs before in the node's thread and refuses by a `MarginGuardError`: such a
    request takes no thread. While a client with another definition of one of our types is known,
    every request is refused, because a request does not name its sender; not with
    ``any_definition``. Up to ``max_waiting`` requests wait for the node's thread, 10 unless
    it is given. ``received_as`` is a type with the type support of the request but another
    conversion to Python, whose result ``check`` and ``handle`` then get; the request is received
    without the GIL.
    rclpy sends no reply when a handler raises. This class then replies with a new response:
    ``success`` is false and ``message`` is the reason, if the type has these fields. A
    `MarginGuardError` is counted in `refused`; other exceptions are counted in `failures` and
    logged.
    """

    def __init__(
        self,
        ros: RosNode,
        service: str | type,
        name: str,
        handle: Callable[[Any, Any], None],
        *,
        in_thread: bool = False,
        check: Callable[[Any], None] | None = None,
        max_waiting: int | None = None,
        any_definition: bool = False,
        received_as: type | None = None,
        lane: Callable[[Any], str] = lambda request: "",
    ) -> None:
        self.type = service_type(service)
        self.refused = 0
        self.failures = 0
        self._ros = ros
        self._handle = handle
        self._check = check
        self._any_definition = any_definition
        self._lane = lane
        self._busy: set[str] = set()  # used in the node's thread only
        try:
            create = ros.node.create_service
            if received_as is not None:
                create = partial(_create_unlocked_service, ros.node, received_as=received_as)
            self._service = create(
                self.type,
                name,
                self._reply_from_thread if in_thread else self._reply,
                qos_profile=_qos(max_waiting),
                # The default group would block the whole node until the thread is done.
                callback_group=ReentrantCallbackGroup() if in_thread else None,
            )
        except Exception as error:  # rclpy has an unrelated type for each way to be invalid
            raise CallError(f"service {name!r} cannot be served: {reason_of(error)}") from error
        self.name = str(self._service.service_name)

    def close(self) -> None:
        """Stop serving."""
        if self._ros.is_open:
            self._ros.node.destroy_service(self._service)

    async def _reply_from_thread(self, request: Any, response: Any) -> Any:
        refusal = self._answer(self._check_all, request)
        if refusal is not None:
            return refusal
        lane = self._lane(request)
        if lane in self._busy:
            self.refused += 1
            return failure_reply(response, f"{self.name} is busy with an earlier request")
        self._busy.add(lane)
        done = Future()

        def work() -> None:
            done.set_result(self._handled(request, response))
            self._ros.wake()

        threading.Thread(target=work, name=f"service {self.name}", daemon=True).start()
        reply = await done
        self._busy.remove(lane)
        return reply

    def _check_all(self, request: Any) -> None:
        self._check_definitions()
        if self._check is not None:
            self._check(request)

    def _check_definitions(self) -> None:
        if self._any_definition:
            return
        foreign = foreign_clients(self._ros.node, self.name, self.type)
        if foreign:
            raise CallError(
                f"{self.name}: {', '.join(sorted(foreign))} has another definition of the request; "
                "expected the marginguard_msgs of this installation on both sides"
            )

    def _reply(self, request: Any, response: Any) -> Any:
        refusal = self._answer(self._check_all, request)
        return self._handled(request, response) if refusal is None else refusal

    def _handled(self, request: Any, response: Any) -> Any:
        refusal = self._answer(self._handle, request, response)
        if refusal is None:  # an invalid response must fail here, not when it is sent
            refusal = self._answer(serialize_message, response)
        return response if refusal is None else refusal

    def _answer(self, handle: Callable[..., object], *arguments: Any) -> Any:
        """Call ``handle``; return the response for a failure, None if there is none."""
        try:
            handle(*arguments)
        except MarginGuardError as error:
            self.refused += 1
            return failure_reply(self.type.Response(), str(error))
        except Exception as error:  # the caller must get a reply for any failure
            self.failures += 1
            reason = f"{type(error).__name__}: {error}"
            self._ros.node.get_logger().error(f"service {self.name} failed: {reason}")
            return failure_reply(self.type.Response(), f"the server failed: {reason}")
        return None


def trigger_server(ros: RosNode, name: str, action: Callable[[], object]) -> ServiceServer:
    """Serve ``name``, a std_srvs/Trigger, by ``action()``; a `MarginGuardError` refuses."""

    def handle(_: Trigger.Request, response: Trigger.Response) -> None:
        action()
        response.success = True

    return ServiceServer(ros, Trigger, name, handle)


def _qos(max_waiting: int | None) -> QoSProfile:
    if max_waiting is None:
        return qos_profile_services_default
    return QoSProfile(depth=max_waiting)  # reliable and volatile, as ROS's default


def failure_reply(message: Any, reason: str) -> Any:
    """Set ``reason`` in the ``message`` field of a default response or result, if it has one.

    In a result of FollowJointTrajectory, whose default is a success, it is the ``error_string``.
    """
    text = reason.encode("utf-8", "replace").decode("utf-8")
    if isinstance(getattr(message, "message", None), str):
        message.message = text
    elif hasattr(message, "GOAL_TOLERANCE_VIOLATED"):
        message.error_code, message.error_string = message.GOAL_TOLERANCE_VIOLATED, text
    return message
