"""Publish the constraint as CRTK's ``servo_ci``, for an arm that closes the loop itself (dVRK).

====================== ============================= ============================================
``ARM/servo_ci``       crtk_msgs/CartesianImpedance  a stiff half-axis along the plane's normal
``ARM/state_command``  crtk_msgs/StringStamped       ``pause``, repeated while nothing is allowed
====================== ============================= ============================================

``servo_ci`` has no expiry: an arm keeps the last one. So an arm that must not move freely is sent
``pause``. `resume` is a request of the arm's operator alone and is never sent.
"""

from geometry_msgs.msg import Quaternion
from scipy.spatial.transform import Rotation

from app.bridge.convert.errors import UnknownTypeError
from app.bridge.convert.types import message_type
from app.bridge.errors import BridgeError
from app.bridge.messages import header_message, metres, vector_message
from app.bridge.node import RosNode
from app.bridge.qos import NEWEST, Topic
from app.control import HalfAxis, ImpedanceParameters
from app.geometry import NS_PER_MS, Stamp

PAUSE_PERIOD_NS = 100 * NS_PER_MS


class ImpedanceOutput:
    """Publishes for ``arm``, whose root link is ``frame``.

    Raises `BridgeError` where ``crtk_msgs`` is not installed.
    """

    def __init__(self, ros: RosNode, arm: str, frame: str, given: ImpedanceParameters) -> None:
        try:
            self._impedance_type = message_type("crtk_msgs/msg/CartesianImpedance")
            self._gains_type = message_type("crtk_msgs/msg/CartesianImpedanceHalfPlaneGains")
            self._text_type = message_type("crtk_msgs/msg/StringStamped")
        except UnknownTypeError as error:
            raise BridgeError(
                "impedance needs crtk_msgs; expected it in the ROS workspace, or installed by "
                "'pip install ./interfaces_extra'"
            ) from error
        self._frame, self._given = frame, given
        self._impedance = ros.publisher(Topic(f"{arm}/servo_ci", self._impedance_type, NEWEST))
        self._command = ros.publisher(Topic(f"{arm}/state_command", self._text_type, NEWEST))
        self._paused_ns: int | None = None

    def publish(self, axis: HalfAxis, now_ns: int) -> None:
        """Publish ``axis``, which is in the arm's root link."""
        self._paused_ns = None
        message = self._impedance_type(header=header_message(self._frame, Stamp(now_ns)))
        x, y, z, w = Rotation.from_matrix(axis.rotation).as_quat().tolist()
        message.force_orientation = Quaternion(x=x, y=y, z=z, w=w)
        message.torque_orientation = Quaternion(w=1.0)
        message.force_position = vector_message(metres(axis.point_mm))
        # The arm multiplies the signed distance and the speed by these: negative gains restore.
        gains = self._gains_type()
        gains.p.z, gains.d.z = -self._given.stiffness_n_m, -self._given.damping_n_s_m
        message.position_negative = gains
        self._impedance.publish(message)

    def pause(self, now_ns: int, *, at_once: bool = False) -> None:
        """Send ``pause``, at most once per `PAUSE_PERIOD_NS`."""
        last_ns = self._paused_ns
        is_due = last_ns is None or not 0 <= now_ns - last_ns < PAUSE_PERIOD_NS
        if at_once or is_due:
            self._paused_ns = now_ns
            header = header_message("", Stamp(now_ns))
            self._command.publish(self._text_type(header=header, string="pause"))
