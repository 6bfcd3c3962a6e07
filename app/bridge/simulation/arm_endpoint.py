"""The topics of one simulated arm, with the names of CRTK.

============================ ============================ ========================================
``measured_js``              sensor_msgs/JointState       positions, velocities and efforts
``setpoint_js``              sensor_msgs/JointState       velocities that the drives follow, and the
                                                          positions of ``servo_jp``
``measured_cp``              geometry_msgs/PoseStamped    the tool in the arm's root link
``setpoint_cp``              geometry_msgs/PoseStamped    the pose of ``servo_cp``, while followed
``measured_cv``              geometry_msgs/TwistStamped   the tool's velocity, axes of the root link
``measured_cf``              geometry_msgs/WrenchStamped  the hand's wrench at the tool, axes of the
                                                          root link
``body/measured_cf``         geometry_msgs/WrenchStamped  the same along the tool's axes
``servo_jv``, ``servo_jp``,  see `arm_commands`           input: motion; each lasts 30 ms
``servo_cp``, ``servo_cv``,
``servo_cf``,
``body/servo_cf``
``operating_state``,         see `ArmStateTopics`         state, and input: commands that change it
``state_command``
``robot_description``        std_msgs/String              the URDF, if the robot is one
============================ ============================ ========================================

All are in the namespace of the arm, ``/NAME``, in m, rad, N. The service ``/NAME/enable`` ends
FAULT; ``/diagnostics`` has its reason.
"""

from collections import deque
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, Quaternion, TwistStamped, WrenchStamped
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from app.bridge.convert.plain import message_type
from app.bridge.messages import (
    diagnostic_status,
    header_message,
    metres,
    point_message,
    quaternion_message,
    vector_message,
)
from app.bridge.node import RosNode
from app.bridge.ros_errors import UnknownTypeError
from app.bridge.simulation.arm_commands import ArmCommands
from app.bridge.topics import LATCHED, NEWEST, STREAM, Topic
from app.geometry import NS_PER_S, FloatArray, Stamp, Transform
from app.robot import urdf_text
from app.simulation import (
    ArmState,
    ArmStatus,
    JointPositionCommand,
    RobotEntry,
    StateCommand,
    ToolPoseCommand,
    Wrench,
)

_MAX_WAITING = 20
_MAX_CHARS = 40

_LEVELS = {
    ArmStatus.DISABLED: DiagnosticStatus.WARN,
    ArmStatus.ENABLED: DiagnosticStatus.OK,
    ArmStatus.PAUSED: DiagnosticStatus.WARN,
    ArmStatus.FAULT: DiagnosticStatus.ERROR,
}

_WRENCHES = "body/measured_cf", "measured_cf"
"""Along the axes of the tool, and of the root link."""


class ArmStateTopics:
    """Publishes the state at each change, latched; keeps commands until they are taken."""

    def __init__(self, ros: RosNode, arm: str) -> None:
        self._arm, self._node = arm, ros.node
        self._waiting: deque[str] = deque(maxlen=_MAX_WAITING)
        self._last: tuple[str, bool] | None = None
        self._publisher: Any = None
        try:
            self._type = message_type("crtk_msgs/msg/OperatingState")
            command_type = message_type("crtk_msgs/msg/StringStamped")
        except UnknownTypeError:
            ros.node.get_logger().info(
                f"/{arm}/operating_state and /{arm}/state_command are missing: crtk_msgs is not "
                "installed (see docs/installation.md); the state is on /diagnostics"
            )
            return
        self._publisher = ros.publisher(Topic(f"/{arm}/operating_state", self._type, LATCHED))
        ros.subscribe(Topic(f"/{arm}/state_command", command_type, NEWEST), self._take)

    def commands(self) -> list[StateCommand]:
        """The commands that have arrived since the last call; others are logged and ignored."""
        found = []
        while self._waiting:
            text = self._waiting.popleft()
            try:
                found.append(StateCommand(text))
            except ValueError:
                self._node.get_logger().warning(
                    f"/{self._arm}/state_command is {text[:_MAX_CHARS]!r}; "
                    f"expected one of {', '.join(StateCommand)}"
                )
        return found

    def publish(self, state: ArmState, stamp: Stamp) -> None:
        """Publish ``state`` if it is another one than before."""
        now = str(state.status), state.is_busy
        if self._publisher is None or now == self._last:
            return
        self._last = now
        self._publisher.publish(
            self._type(
                header=header_message("", stamp), state=now[0], is_homed=True, is_busy=now[1]
            )
        )

    def _take(self, message: Any) -> None:
        self._waiting.append(message.string)


class ArmEndpoint:
    """Publishes the state of the arm ``entry`` and receives its commands.

    ``has_hand``: the hand's wrench is published here, so that no other node may do so.
    """

    def __init__(self, ros: RosNode, entry: RobotEntry, *, has_hand: bool = False) -> None:
        self.entry = entry
        name = entry.name
        self._measured = ros.publisher(Topic(f"/{name}/measured_js", JointState, STREAM))
        self._setpoint = ros.publisher(Topic(f"/{name}/setpoint_js", JointState, STREAM))
        self._pose = ros.publisher(Topic(f"/{name}/measured_cp", PoseStamped, STREAM))
        self._twist = ros.publisher(Topic(f"/{name}/measured_cv", TwistStamped, STREAM))
        self._pose_setpoint = ros.publisher(Topic(f"/{name}/setpoint_cp", PoseStamped, STREAM))
        self._wrenches = (
            [ros.publisher(Topic(f"/{name}/{each}", WrenchStamped, STREAM)) for each in _WRENCHES]
            if has_hand
            else []
        )
        if entry.file is not None and entry.file.suffix == ".urdf":
            described = ros.publisher(Topic(f"/{name}/robot_description", String, LATCHED))
            described.publish(String(data=urdf_text(entry.file)))
        self._last: tuple[int, Transform] | None = None
        self.commands = ArmCommands(ros, name)
        self.operating = ArmStateTopics(ros, name)

    def publish(
        self, state: ArmState, world_from_tool: Transform | None, hand: Wrench | None, stamp: Stamp
    ) -> None:
        """Publish ``state``; ``hand`` is the wrench on the tool along the axes of the world.

        Messages that no node receives are not made: making them takes a fifth of a core.
        """
        header, names = header_message("", stamp), list(state.joints)
        if has_reader(self._measured):
            self._measured.publish(
                JointState(
                    header=header,
                    name=names,
                    position=state.positions.tolist(),
                    velocity=state.velocities.tolist(),
                    effort=state.efforts.tolist(),
                )
            )
        if has_reader(self._setpoint):
            setpoint = JointState(header=header, name=names, velocity=state.setpoints.tolist())
            if isinstance(state.command, JointPositionCommand):
                setpoint.position = list(state.command.positions)
            self._setpoint.publish(setpoint)
        if isinstance(state.command, ToolPoseCommand):
            self._publish_pose_setpoint(state.command, stamp)
        if world_from_tool is not None:
            base_from_tool = self.entry.world_from_base.inverse() @ world_from_tool
            self._publish_tool(base_from_tool, stamp)
            if hand is not None:
                self._publish_hand(world_from_tool, hand, stamp)

    def status(self, state: ArmState) -> DiagnosticStatus:
        """The arm's state for ``/diagnostics``."""
        values = {"operating_state": state.status, "is_busy": str(state.is_busy).lower()}
        level, text = _LEVELS[state.status], state.fault or str(state.status)
        return diagnostic_status(f"arm {self.entry.name}", level, text, values, self.entry.name)

    def _publish_tool(self, base_from_tool: Transform, stamp: Stamp) -> None:
        header = header_message(base_from_tool.target, stamp)
        if has_reader(self._pose):
            message = PoseStamped(header=header)
            message.pose.position = point_message(base_from_tool.translation_mm)
            message.pose.orientation = quaternion_message(base_from_tool)
            self._pose.publish(message)
        last, self._last = self._last, (stamp.ns, base_from_tool)
        if last is not None and stamp.ns > last[0] and has_reader(self._twist):
            linear, angular = _velocity(last[1], base_from_tool, (stamp.ns - last[0]) / NS_PER_S)
            twist = TwistStamped(header=header)
            twist.twist.linear = vector_message(metres(linear))
            twist.twist.angular = vector_message(angular)
            self._twist.publish(twist)

    def _publish_pose_setpoint(self, command: ToolPoseCommand, stamp: Stamp) -> None:
        message = PoseStamped(header=header_message(command.frame, stamp))
        message.pose.position = point_message(command.position_mm)
        x, y, z, w = command.quaternion
        message.pose.orientation = Quaternion(x=x, y=y, z=z, w=w)
        self._pose_setpoint.publish(message)

    def _publish_hand(self, world_from_tool: Transform, hand: Wrench, stamp: Stamp) -> None:
        tool, root = world_from_tool, self.entry.world_from_base
        axes_of = ((tool.source, tool.rotation), (root.source, root.rotation))
        for publisher, (frame, axes) in zip(self._wrenches, axes_of, strict=False):
            if not has_reader(publisher):
                continue
            message = WrenchStamped(header=header_message(frame, stamp))
            message.wrench.force = vector_message(axes.T @ hand.force_n)
            message.wrench.torque = vector_message(axes.T @ hand.torque_n_m)
            publisher.publish(message)


def has_reader(publisher: Publisher) -> bool:
    """True if a node receives what ``publisher`` sends. Takes less than a microsecond."""
    return int(publisher.get_subscription_count()) > 0


def _velocity(before: Transform, now: Transform, step_s: float) -> tuple[FloatArray, FloatArray]:
    """Mean velocity in mm/s and angular velocity in rad/s between two poses, in their target."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(now.rotation @ before.rotation.T).as_rotvec()
    return (now.translation_mm - before.translation_mm) / step_s, np.asarray(turn / step_s)
