"""Operator services of a running session: ``~/set_tumor`` and ``~/register``."""

import numpy as np
from geometry_msgs.msg import Point
from marginguard_msgs.srv import Register, SetTumor

from app.bridge import messages
from app.bridge.calls.service_server import ServiceServer
from app.bridge.errors import BridgeError
from app.bridge.node import RosNode
from app.geometry import FloatArray, Stamp, SurfaceMesh, Transform
from app.registration import register_points
from app.runtime import OperatorCommands

MAX_TRIANGLES = 500_000
MAX_POINTS = 1_000


class OperatorServices:
    """Serves both until the node is closed. A refused request changes nothing and has a reason.

    Each service runs in its own thread, one request at a time. Computing the field of a new tumour
    takes seconds, during which the session continues with the old one, and any change waits for
    the current step, during which samples must be received.
    """

    def __init__(self, ros: RosNode, commands: OperatorCommands) -> None:
        self._commands = commands
        ServiceServer(ros, SetTumor, "~/set_tumor", self._set_tumor, in_thread=True)
        ServiceServer(ros, Register, "~/register", self._register, in_thread=True)

    def _set_tumor(self, request: SetTumor.Request, response: SetTumor.Response) -> None:
        frame = self._commands.setup.frame_from_tumor.source
        tumor = _surface(request, frame)
        pose = request.pose
        position, rotation = pose.position, pose.orientation
        frame_from_tumor = Transform.from_quaternion(
            (rotation.x, rotation.y, rotation.z, rotation.w),
            messages.MM_PER_M * np.array([position.x, position.y, position.z]),
            target=request.header.frame_id,
            source=frame,
        )
        response.model_id = self._commands.set_tumor(frame_from_tumor, tumor)
        response.success = True

    def _register(self, request: Register.Request, response: Register.Response) -> None:
        fixed, moving = request.fixed_points, request.moving_points
        if not fixed and not moving:
            raise BridgeError(
                "no points given; expected pairs of points (dwells are not collected live)"
            )
        if max(len(fixed), len(moving)) > MAX_POINTS:
            raise BridgeError(
                f"{len(fixed)} and {len(moving)} points given; expected at most {MAX_POINTS} each"
            )
        result = register_points(
            _points_mm(fixed),
            _points_mm(moving),
            fixed_frame=request.fixed_frame,
            moving_frame=request.moving_frame,
        )
        response.registration_id = self._commands.set_registration(result)
        response.transform = messages.transform_message(result.transform, Stamp(0)).transform
        response.fre = float("nan") if result.fre_mm is None else result.fre_mm / messages.MM_PER_M
        response.success = True


def _surface(request: SetTumor.Request, frame: str) -> SurfaceMesh:
    triangles, vertices = request.mesh.triangles, request.mesh.vertices
    if not 0 < len(triangles) <= MAX_TRIANGLES or len(vertices) > 3 * MAX_TRIANGLES:
        raise BridgeError(
            f"the surface has {len(triangles)} triangles and {len(vertices)} vertices; "
            f"expected 1 to {MAX_TRIANGLES} triangles"
        )
    faces = np.array([triangle.vertex_indices for triangle in triangles])
    return SurfaceMesh(frame, _points_mm(vertices), faces)


def _points_mm(points: list[Point]) -> FloatArray:
    """Points (n, 3) in mm."""
    values = np.array([(point.x, point.y, point.z) for point in points], dtype=np.float64)
    return np.asarray(messages.MM_PER_M * values.reshape(-1, 3))
