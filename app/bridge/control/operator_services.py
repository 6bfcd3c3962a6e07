"""Operator services of a running session: ``~/set_tumor`` and ``~/register``."""

from functools import partial

import numpy as np
from geometry_msgs.msg import Point
from marginguard_msgs.srv import Register, SetTumor

from app.bridge import messages
from app.bridge.calls.service_server import ServiceServer
from app.bridge.control.margin_parameters import OVER_ROS
from app.bridge.control.operator_requests import OperatorRequests
from app.bridge.control.tumor_request import ArrayRequest, TumorRequest
from app.bridge.errors import BridgeError
from app.bridge.node import RosNode
from app.geometry import FloatArray, Stamp, SurfaceMesh, Transform
from app.registration import RegistrationResult, register_points
from app.runtime import OperatorCommands, RequestKind
from app.runtime.new_tumor import MAX_LIVE_TRIANGLES

MAX_POINTS = 1_000


class OperatorServices:
    """Serves both until the node is closed. A refused request changes nothing and has a reason.

    Each service runs in its own thread, one request at a time. Computing the field of a new tumour
    takes seconds, during which the session continues with the old one, and any change waits for
    the current step, during which samples must be received. ``requests`` checks who may send them
    and how many, before a thread is started.
    """

    def __init__(
        self, ros: RosNode, commands: OperatorCommands, requests: OperatorRequests
    ) -> None:
        self._commands = commands
        self._requests = requests
        for service, name, handle, kind, received_as in (
            (SetTumor, "~/set_tumor", self._set_tumor, RequestKind.TUMOR, ArrayRequest),
            (Register, "~/register", self._register, RequestKind.REGISTRATION, None),
        ):
            check = partial(self._check, kind, name)
            ServiceServer(
                ros, service, name, handle, in_thread=True, check=check, received_as=received_as
            )

    def _check(self, kind: RequestKind, name: str, request: object) -> None:
        with self._requests.refusals(kind):
            self._requests.check(kind, name)

    def _set_tumor(self, request: TumorRequest, response: SetTumor.Response) -> None:
        with self._requests.refusals(RequestKind.TUMOR):
            frame_from_tumor, tumor = self._tumor(request)
        response.model_id = self._commands.set_tumor(frame_from_tumor, tumor, origin=OVER_ROS)
        response.success = True

    def _tumor(self, request: TumorRequest) -> tuple[Transform, SurfaceMesh]:
        frame = self._commands.setup.frame_from_tumor.source
        tumor = _surface(request, frame)
        frame_from_tumor = Transform.from_quaternion(
            tuple(request.quaternion.tolist()),
            messages.MM_PER_M * request.position_m,
            target=request.frame_id,
            source=frame,
        )
        return frame_from_tumor, tumor

    def _register(self, request: Register.Request, response: Register.Response) -> None:
        with self._requests.refusals(RequestKind.REGISTRATION):
            result = _registration(request)
        response.registration_id = self._commands.set_registration(result, origin=OVER_ROS)
        response.transform = messages.transform_message(result.transform, Stamp(0)).transform
        response.fre = float("nan") if result.fre_mm is None else result.fre_mm / messages.MM_PER_M
        response.success = True


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


def _surface(request: TumorRequest, frame: str) -> SurfaceMesh:
    triangles, vertices = request.triangles, request.vertices_m
    # Before they are copied and checked, which takes longer than their count.
    if not 0 < len(triangles) <= MAX_LIVE_TRIANGLES or len(vertices) > 3 * MAX_LIVE_TRIANGLES:
        raise BridgeError(
            f"the surface has {len(triangles)} triangles and {len(vertices)} vertices; "
            f"expected 1 to {MAX_LIVE_TRIANGLES} triangles in a live session: reduce its resolution"
        )
    return SurfaceMesh(frame, messages.MM_PER_M * vertices, triangles.astype(np.int64))


def _points_mm(points: list[Point]) -> FloatArray:
    """Points (n, 3) in mm."""
    values = np.array([(point.x, point.y, point.z) for point in points], dtype=np.float64)
    return np.asarray(messages.MM_PER_M * values.reshape(-1, 3))
