"""What an operator asks of a running session: ``~/set_tumor`` and ``~/register``."""

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

MOST_TRIANGLES = 500_000
MOST_POINTS = 1_000


class OperatorServices:
    """Serves both until the node is closed; a refusal says why, and then nothing has changed.

    Each is answered from a thread of its own, one request at a time: the field of a new tumour
    takes seconds, in which the old one is guarded, and any change waits for the step that is being
    taken, in which samples have to be heard.
    """

    def __init__(self, ros: RosNode, commands: OperatorCommands) -> None:
        self._commands = commands
        ServiceServer(ros, SetTumor, "~/set_tumor", self._set_tumor, in_thread=True)
        ServiceServer(ros, Register, "~/register", self._register, in_thread=True)

    def _set_tumor(self, request: SetTumor.Request, response: SetTumor.Response) -> None:
        frame = self._commands.setup.frame_from_tumor.source
        tumor = _surface(request, frame)
        pose = request.pose
        place, turn = pose.position, pose.orientation
        frame_from_tumor = Transform.from_quaternion(
            (turn.x, turn.y, turn.z, turn.w),
            messages.MM_PER_M * np.array([place.x, place.y, place.z]),
            target=request.header.frame_id,
            source=frame,
        )
        response.model_id = self._commands.set_tumor(frame_from_tumor, tumor)
        response.success = True

    def _register(self, request: Register.Request, response: Register.Response) -> None:
        fixed, moving = request.fixed_points, request.moving_points
        if not fixed and not moving:
            raise BridgeError("no points were given, and no landmark dwells are collected here")
        if max(len(fixed), len(moving)) > MOST_POINTS:
            raise BridgeError(f"{len(fixed)} and {len(moving)} points: {MOST_POINTS} allowed")
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
    if not 0 < len(triangles) <= MOST_TRIANGLES or len(vertices) > 3 * MOST_TRIANGLES:
        raise BridgeError(
            f"the surface has {len(triangles)} triangles and {len(vertices)} vertices: "
            f"1 to {MOST_TRIANGLES} triangles wanted"
        )
    faces = np.array([triangle.vertex_indices for triangle in triangles])
    return SurfaceMesh(frame, _points_mm(vertices), faces)


def _points_mm(points: list[Point]) -> FloatArray:
    """(n, 3) in mm."""
    values = np.array([(point.x, point.y, point.z) for point in points], dtype=np.float64)
    return np.asarray(messages.MM_PER_M * values.reshape(-1, 3))
