"""The topics of one simulated arm, with the names of CRTK.

============================ ============================ ========================================
``measured_js``              sensor_msgs/JointState       positions, velocities and efforts
``setpoint_js``              sensor_msgs/JointState       velocities that the drives follow
``measured_cp``              geometry_msgs/PoseStamped    the tool in the arm's root link
``measured_cv``              geometry_msgs/TwistStamped   the tool's velocity, axes of the root link
``body/measured_cf``         geometry_msgs/WrenchStamped  the hand's wrench at the tool, its axes
``servo_jv``                 sensor_msgs/JointState       input: joint velocities; lasts 30 ms
``robot_description``        std_msgs/String              the URDF, if the robot is one
============================ ============================ ========================================

All are in the namespace of the arm, ``/NAME``, in m, rad, N. CRTK's ``operating_state`` needs
``crtk_msgs``, which cannot be installed from PyPI: the state is on ``/diagnostics`` and the service
``/NAME/enable`` ends FAULT.
"""

import threading

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from app.bridge.messages import (
    header_message,
    metres,
    point_message,
    quaternion_message,
    vector_message,
)
from app.bridge.node import RosNode
from app.bridge.qos import LATCHED, NEWEST, STREAM, Topic
from app.geometry import NS_PER_S, FloatArray, Stamp, Transform
from app.robot import urdf_text
from app.simulation import ArmState, ArmStatus, JointVelocityCommand, RobotEntry, Wrench

MAX_AHEAD_NS = 5_000_000
"""A command may be stamped as much ahead: physics and sender are two processes."""

_LEVELS = {
    ArmStatus.ENABLED: DiagnosticStatus.OK,
    ArmStatus.PAUSED: DiagnosticStatus.OK,
    ArmStatus.FAULT: DiagnosticStatus.ERROR,
}


class ArmEndpoint:
    """Publishes the state of the arm ``entry`` and receives its commands."""

    def __init__(self, ros: RosNode, entry: RobotEntry) -> None:
        self.entry = entry
        name = entry.name
        self._node = ros.node
        self._measured = ros.publisher(Topic(f"/{name}/measured_js", JointState, STREAM))
        self._setpoint = ros.publisher(Topic(f"/{name}/setpoint_js", JointState, STREAM))
        self._pose = ros.publisher(Topic(f"/{name}/measured_cp", PoseStamped, STREAM))
        self._twist = ros.publisher(Topic(f"/{name}/measured_cv", TwistStamped, STREAM))
        self._wrench = ros.publisher(Topic(f"/{name}/body/measured_cf", WrenchStamped, STREAM))
        if entry.file is not None and entry.file.suffix == ".urdf":
            described = ros.publisher(Topic(f"/{name}/robot_description", String, LATCHED))
            described.publish(String(data=urdf_text(entry.file)))
        self._lock = threading.Lock()
        self._arrived: tuple[JointState, int] | None = None
        self._last: tuple[int, Transform] | None = None
        self._command_topic = f"/{name}/servo_jv"
        ros.subscribe(Topic(self._command_topic, JointState, NEWEST), self._take)

    def second_controller(self) -> str:
        """Why motion of this arm has more than one source; empty if it has not."""
        count = self._node.count_publishers(self._command_topic)
        return f"{self._command_topic} has {count} publishers; expected 1" if count > 1 else ""

    def command(self, host_ns: int, time_ns: int) -> JointVelocityCommand | None:
        """The command that has arrived since the last call, on the simulation's clock.

        ``host_ns`` and ``time_ns`` are the present on both clocks. A stamp that was in the future
        when the message arrived stays in the future, which the arm refuses. The present of a
        physics that was interrupted may be before the arrival.
        """
        with self._lock:
            arrived, self._arrived = self._arrived, None
        if arrived is None:
            return None
        message, arrived_ns = arrived
        stamp = message.header.stamp
        stamp_ns = stamp.sec * NS_PER_S + stamp.nanosec
        age_ns = min(arrived_ns - stamp_ns, 0)
        if age_ns >= -MAX_AHEAD_NS:
            age_ns = max(host_ns - stamp_ns, 0)
        return JointVelocityCommand(time_ns - age_ns, tuple(message.name), tuple(message.velocity))

    def publish(
        self, state: ArmState, world_from_tool: Transform | None, hand: Wrench | None, stamp: Stamp
    ) -> None:
        """Publish ``state``; ``hand`` is the wrench on the tool along the axes of the world."""
        header = header_message("", stamp)
        names = list(state.joints)
        self._measured.publish(
            JointState(
                header=header,
                name=names,
                position=state.positions.tolist(),
                velocity=state.velocities.tolist(),
                effort=state.efforts.tolist(),
            )
        )
        self._setpoint.publish(
            JointState(header=header, name=names, velocity=state.setpoints.tolist())
        )
        if world_from_tool is not None:
            base_from_tool = self.entry.world_from_base.inverse() @ world_from_tool
            self._publish_tool(base_from_tool, stamp)
            if hand is not None:
                self._publish_hand(world_from_tool, hand, stamp)

    def status(self, state: ArmState) -> DiagnosticStatus:
        """The arm's state for ``/diagnostics``."""
        return DiagnosticStatus(
            level=_LEVELS[state.status],
            name=f"marginguard: arm {self.entry.name}",
            message=state.fault or str(state.status),
            hardware_id=self.entry.name,
            values=[KeyValue(key="operating_state", value=str(state.status))],
        )

    def _publish_tool(self, base_from_tool: Transform, stamp: Stamp) -> None:
        header = header_message(base_from_tool.target, stamp)
        message = PoseStamped(header=header)
        message.pose.position = point_message(base_from_tool.translation_mm)
        message.pose.orientation = quaternion_message(base_from_tool)
        self._pose.publish(message)
        last, self._last = self._last, (stamp.ns, base_from_tool)
        if last is not None and stamp.ns > last[0]:
            linear, angular = _velocity(last[1], base_from_tool, (stamp.ns - last[0]) / NS_PER_S)
            twist = TwistStamped(header=header)
            twist.twist.linear = vector_message(metres(linear))
            twist.twist.angular = vector_message(angular)
            self._twist.publish(twist)

    def _publish_hand(self, world_from_tool: Transform, hand: Wrench, stamp: Stamp) -> None:
        message = WrenchStamped(header=header_message(world_from_tool.source, stamp))
        message.wrench.force = vector_message(world_from_tool.rotation.T @ hand.force_n)
        message.wrench.torque = vector_message(world_from_tool.rotation.T @ hand.torque_n_m)
        self._wrench.publish(message)

    def _take(self, message: JointState) -> None:
        """Keep a command. Runs in the node's thread."""
        now_ns = self._node.get_clock().now().nanoseconds
        with self._lock:
            self._arrived = message, now_ns


def _velocity(before: Transform, now: Transform, step_s: float) -> tuple[FloatArray, FloatArray]:
    """Mean velocity in mm/s and angular velocity in rad/s between two poses, in their target."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(now.rotation @ before.rotation.T).as_rotvec()
    return (now.translation_mm - before.translation_mm) / step_s, np.asarray(turn / step_s)
