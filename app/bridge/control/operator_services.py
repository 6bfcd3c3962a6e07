"""Operator services of a session: surfaces, registration, recordings, and the re-arm.

Requests with a surface are received as arrays, and converted to millimetres.
"""

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import new_class
from typing import Any

import numpy as np
from geometry_msgs.msg import Point
from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.srv import Rearm, Register, SetStructure, SetTumor, SwitchStructure
from numpy.typing import NDArray
from std_srvs.srv import SetBool

from app.bridge import messages
from app.bridge.calls.service_client import ServiceClient
from app.bridge.calls.service_server import ServiceServer
from app.bridge.control.operator_requests import OVER_ROS, OperatorRequests
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.bridge.topics import NEWEST, Topic
from app.geometry import FloatArray, Stamp, SurfaceMesh, Transform
from app.hold import SeenHold
from app.registration import RegistrationResult, register_points
from app.runtime import LatestValue, OperatorCommands, RequestKind, StructureContent
from app.runtime.session_changes import MAX_LIVE_TRIANGLES
from app.session.structure import role_of


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceRequest:
    """The content of a `SetTumor.Request`, in its units.

    ``position_m`` (3,) and ``quaternion`` (4,), xyzw, are its pose in ``frame_id``. ``triangles``
    (m, 3) are vertex indices, ``vertices_m`` (n, 3) positions.
    """

    frame_id: str
    position_m: FloatArray
    quaternion: FloatArray
    triangles: NDArray[np.uint32]
    vertices_m: FloatArray

    def surface(self, frame: str) -> SurfaceMesh:
        """The surface, in ``frame``. Raises `MarginGuardError` for one of a wrong size."""
        triangles, vertices = self.triangles, self.vertices_m
        # Before they are copied and checked, which takes longer than their count.
        if not 0 < len(triangles) <= MAX_LIVE_TRIANGLES or len(vertices) > 3 * MAX_LIVE_TRIANGLES:
            raise BridgeError(
                f"the surface has {len(triangles)} triangles and {len(vertices)} vertices; "
                f"expected 1 to {MAX_LIVE_TRIANGLES} triangles in a live session: reduce its "
                "resolution"
            )
        return SurfaceMesh(frame, messages.MM_PER_M * vertices, triangles.astype(np.int64))

    def pose(self, frame: str) -> Transform:
        """The pose of ``frame`` in ``frame_id``."""
        return Transform.from_quaternion(
            tuple(self.quaternion.tolist()),
            messages.MM_PER_M * self.position_m,
            target=self.frame_id,
            source=frame,
        )


@dataclass(frozen=True, slots=True, eq=False)
class StructureRequest(SurfaceRequest):
    """The content of a `SetStructure.Request`; distances and ``sigma_m`` in m."""

    name: str
    role: str
    stop_m: float
    warn_m: float
    sigma_m: float

    def structure(self) -> StructureContent:
        """The structure in mm. Raises `InputError` for another role, and as `surface`."""
        role = role_of(self.role)
        stop_mm, warn_mm, sigma_mm = (
            messages.MM_PER_M * each for each in (self.stop_m, self.warn_m, self.sigma_m)
        )
        return StructureContent(self.surface(self.name), role, stop_mm, warn_mm, sigma_mm)


_SurfaceValues = tuple[str, FloatArray, FloatArray, NDArray[Any], NDArray[Any]]


class _Array(ctypes.Structure):  # a string or a sequence
    _fields_ = [("data", ctypes.c_void_p), ("size", ctypes.c_size_t), ("room", ctypes.c_size_t)]


class _Surface(ctypes.Structure):
    _fields_ = [
        ("sec", ctypes.c_int32),
        ("nanosec", ctypes.c_uint32),
        ("frame_id", _Array),
        ("pose", ctypes.c_double * 7),
        ("triangles", _Array),  # of uint32[3]
        ("vertices", _Array),  # of double[3]
    ]


class _Structure(_Surface):
    _fields_ = [("name", _Array), ("role", _Array), ("distances", ctypes.c_double * 3)]


def _structure_request(address: int) -> StructureRequest:
    request = _Structure.from_address(address)
    name, role = _text(request.name), _text(request.role)
    stop_m, warn_m, sigma_m = request.distances
    return StructureRequest(*_surface_values(request), name, role, stop_m, warn_m, sigma_m)


def _surface_values(request: _Surface) -> _SurfaceValues:
    pose = np.array(request.pose)
    return (
        _text(request.frame_id),
        pose[:3],
        pose[3:],
        _rows(request.triangles, np.uint32),
        _rows(request.vertices, np.float64),
    )


def _text(text: _Array) -> str:
    return ctypes.string_at(text.data, text.size).decode("utf-8", "replace")


def _rows(sequence: _Array, dtype: Any) -> NDArray[Any]:
    rows = np.empty((sequence.size, 3), dtype=dtype)
    ctypes.memmove(rows.ctypes.data, sequence.data, rows.nbytes)  # releases the GIL
    return rows


_new_capsule = ctypes.pythonapi.PyCapsule_New
_new_capsule.restype = ctypes.py_object
_new_capsule.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]

_Converter = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p)
_converters: list[Any] = []
"""Must stay: C calls them."""


def _array_request(kind: Any, read: Callable[[int], SurfaceRequest]) -> Any:
    """A request of ``kind`` that rclpy receives as what ``read`` makes of its C structure.

    rclpy converts a message element by element while it holds the GIL: 1 s for 300 000 triangles,
    during which no constraint is sent. This type replaces that conversion by copies of the two
    arrays. The layout of the C structures is the one that rosidl_generator_c defines.
    """
    kind.Request.__class__.__import_type_support__()
    converter = _Converter(read)
    _converters.append(converter)
    capsule = _new_capsule(ctypes.cast(converter, ctypes.c_void_p), None, None)
    support = type("ArrayRequestType", (type(kind.Request),), {"_CONVERT_TO_PY": capsule})
    return new_class("ArrayRequest", (kind.Request,), {"metaclass": support})


ArrayRequest = _array_request(
    SetTumor, lambda address: SurfaceRequest(*_surface_values(_Surface.from_address(address)))
)
StructureArrayRequest = _array_request(SetStructure, _structure_request)


MAX_POINTS = 1_000

MAX_WAITING = 1000
"""Requests that wait for the node's thread. The oldest one is dropped for a new one: with ROS's
default of 10 a burst of another node would drop a valid request."""


class OperatorServices:
    """Serves the requests of operators but the re-arm, each by its kind, until the node is closed.

    A refused request changes nothing and has a reason.

    Each service runs in its own thread, one request at a time. Computing the field of a new surface
    takes seconds, during which the session continues with the old one, and any change waits for
    the current step, during which samples must be received. The recorder takes seconds to start.
    ``requests`` checks who may send them and how many, before a thread is started.
    """

    def __init__(
        self, ros: RosNode, commands: OperatorCommands, requests: OperatorRequests
    ) -> None:
        self._commands = commands
        self._requests = requests
        for kind, service, handle, received_as in (
            (RequestKind.TUMOR, SetTumor, self._set_tumor, ArrayRequest),
            (RequestKind.STRUCTURE, SetStructure, self._set_structure, StructureArrayRequest),
            (RequestKind.SWITCH, SwitchStructure, self._switch_structure, None),
            (RequestKind.REGISTRATION, Register, self._register, None),
            (RequestKind.RECORD, SetBool, self._record, None),
        ):
            name = f"~/{kind}"
            check = partial(self._check, kind, name)
            ServiceServer(
                ros, service, name, handle, in_thread=True, check=check, received_as=received_as
            )

    def _check(self, kind: str, name: str, request: object) -> None:
        with self._requests.refusals(kind):
            self._requests.check(kind, name)

    def _set_tumor(self, request: SurfaceRequest, response: SetTumor.Response) -> None:
        with self._requests.refusals(RequestKind.TUMOR):
            frame = self._commands.setup.frame_from_tumor.source
            tumor, frame_from_tumor = request.surface(frame), request.pose(frame)
        response.model_id = self._commands.set_tumor(frame_from_tumor, tumor, origin=OVER_ROS)
        response.success = True

    def _set_structure(self, request: StructureRequest, response: SetStructure.Response) -> None:
        with self._requests.refusals(RequestKind.STRUCTURE):
            structure, frame_from_structure = request.structure(), request.pose(request.name)
        response.setup_id = self._commands.set_structure(
            structure, frame_from_structure, origin=OVER_ROS
        )
        response.success = True

    def _switch_structure(
        self, request: SwitchStructure.Request, response: SwitchStructure.Response
    ) -> None:
        response.setup_id = self._commands.switch_structure(
            request.name, on=request.on, reason=request.reason, origin=OVER_ROS
        )
        response.success = True

    def _register(self, request: Register.Request, response: Register.Response) -> None:
        with self._requests.refusals(RequestKind.REGISTRATION):
            result = _registration(request)
        response.registration_id = self._commands.set_registration(result, origin=OVER_ROS)
        response.transform = messages.transform_message(result.transform, Stamp(0)).transform
        response.fre = float("nan") if result.fre_mm is None else result.fre_mm / messages.MM_PER_M
        response.success = True

    def _record(self, request: SetBool.Request, response: SetBool.Response) -> None:
        """True starts a recording, False stops it; the reply has its folder."""
        if request.data:
            status = self._commands.start_recording(origin=OVER_ROS)
        else:
            status = self._commands.stop_recording(origin=OVER_ROS)
        response.success, response.message = True, status.line


def _registration(request: Register.Request) -> RegistrationResult:
    fixed, moving = request.fixed_points, request.moving_points
    if not fixed and not moving:
        raise BridgeError(
            "no points given; expected pairs of points (dwells are not collected live)"
        )
    if max(len(fixed), len(moving)) > MAX_POINTS:
        raise BridgeError(
            f"{len(fixed)} and {len(moving)} points given; expected at most {MAX_POINTS} each"
        )
    return register_points(
        _points_mm(fixed),
        _points_mm(moving),
        fixed_frame=request.fixed_frame,
        moving_frame=request.moving_frame,
    )


def _points_mm(points: list[Point]) -> FloatArray:
    """Points (n, 3) in mm."""
    values = np.array([(point.x, point.y, point.z) for point in points], dtype=np.float64)
    return np.asarray(messages.MM_PER_M * values.reshape(-1, 3))


class RearmService:
    """Serves ``~/rearm`` until the node is closed.

    A request contains the ``seq`` and the ``rearm_nonce`` of the constraint that the operator was
    looking at; `OperatorCommands.rearm` checks them between two steps. It runs in its own thread,
    because samples must be received while it waits for a step. A request that is invalid at once
    is refused without a thread, so that a flood of them does not occupy it.
    """

    def __init__(
        self, ros: RosNode, commands: OperatorCommands, requests: OperatorRequests
    ) -> None:
        self._commands = commands
        self._requests = requests
        ServiceServer(
            ros,
            Rearm,
            "~/rearm",
            self._serve,
            in_thread=True,
            check=self._check,
            max_waiting=MAX_WAITING,
            # A misread request has no valid nonce, and another client must not prevent a valid one.
            any_definition=True,
        )

    def _check(self, request: Rearm.Request) -> None:
        with self._requests.refusals(RequestKind.REARM):
            self._commands.check_rearm(SeenHold(request.seq, request.nonce))
            self._requests.check(RequestKind.REARM, "~/rearm")

    def _serve(self, request: Rearm.Request, response: Rearm.Response) -> None:
        self._commands.rearm(SeenHold(request.seq, request.nonce), origin=OVER_ROS)
        response.success = True


class RearmClient:
    """Reads the constraints of the guard ``name`` (a node in the namespace of ``ros``)."""

    def __init__(self, ros: RosNode, name: str) -> None:
        self._ros = ros
        self._latest: LatestValue[FixtureConstraint] = LatestValue()
        self._service = ServiceClient(ros, Rearm, f"{name}/rearm")
        topic = Topic(f"{name}/constraint", FixtureConstraint, NEWEST)
        self.topic = str(ros.subscribe(topic, self._latest.put).topic_name)

    def constraint(self, timeout_s: float) -> FixtureConstraint:
        """Wait for the next constraint, not one that has arrived before the call.

        Raises `BridgeError` if none arrives or several guards send.
        """
        self._latest.take(0.0)
        found = self._latest.take(timeout_s)
        problems = self._ros.definition_problems
        if problems:
            raise BridgeError(problems[0])
        if found is None:
            raise BridgeError(
                f"{self.topic}: no constraint within {timeout_s:g} s; expected a running guard "
                "('marginguard live') in this ROS domain and namespace"
            )
        self._check_single()
        return found

    def rearm(self, seen: FixtureConstraint, timeout_s: float) -> Rearm.Response:
        """Request the end of the hold that the operator saw. Raises `CallError`.

        Raises `BridgeError` and sends nothing if several guards are known by now: one could re-arm
        and another refuse. The request is sent once, because its nonce is valid once.
        """
        self._check_single()
        return self._service.call(Rearm.Request(seq=seen.seq, nonce=seen.rearm_nonce), timeout_s)

    def _check_single(self) -> None:
        publishers = self._ros.node.count_publishers(self.topic)
        if publishers > 1:
            raise BridgeError(f"{self.topic}: {publishers} publishers; expected a single guard")
