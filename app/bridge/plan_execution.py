"""The ROS node that executes a planned motion of an arm with CRTK's topics, within the constraint.

========================== ===================================== ===================================
``/ARM/measured_js``       sensor_msgs/JointState                input: the joints
constraint, tracker        as of `app.bridge.arm_control`        input
``/ARM/servo_jp``          sensor_msgs/JointState                joint positions, 200 Hz, from the
                                                                 start of the motion on
``~/cancel``               std_srvs/Trigger                      stop for good
========================== ===================================== ===================================
"""

import threading
import time
from collections.abc import Callable

from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from app.bridge.arm_control import control_periods
from app.bridge.arm_inputs import BasePose, ConstraintInput, JointInput
from app.bridge.calls.service_server import ServiceServer
from app.bridge.messages import header_message
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.bridge.sender_names import publishers_text
from app.bridge.topics import MOTION, NEWEST, Topic
from app.control import ControlDescription, ExecutionStep, Outcome, PlanExecution, PlannedMotion
from app.geometry import NS_PER_MS, NS_PER_S, Stamp

NODE_NAME = "marginguard_execute"

LISTEN_S, WAIT_S = 1.0, 5.0
"""Time for other nodes to appear, and longest wait for inputs that allow the start."""

_LOOK_NS = 100 * NS_PER_MS
"""Time between two looks for other senders."""

_REPORT_NS = NS_PER_S


class ExecutionNode:
    """Executes ``motion`` with the arm of ``description``. ``clock_ns`` is the host's clock."""

    def __init__(
        self,
        ros: RosNode,
        description: ControlDescription,
        motion: PlannedMotion,
        *,
        clock_ns: Callable[[], int],
    ) -> None:
        self._ros, self._arm, self._clock_ns = ros, description.arm, clock_ns
        self._joint_names = description.tool.joints
        self._execution = PlanExecution(description, motion)
        self._joints = JointInput(ros, description.arm)
        self._base = BasePose(ros, description.tracker_topic, description.frame_from_base)
        self._constraints = ConstraintInput(ros, description.constraint_topic)
        self._cancelled = threading.Event()
        ServiceServer(ros, Trigger, "~/cancel", self._cancel)

    def cancel(self) -> None:
        """Stop the motion within its accelerations, for good. Call it from any thread."""
        self._cancelled.set()

    def run(self, report: Callable[[ExecutionStep], None]) -> ExecutionStep | None:
        """Execute the motion and return its last step; None if it was cancelled before it began.

        ``report`` is called each second. Raises `BridgeError` if it may not begin.
        """
        if not self._wait_for_start():
            return None
        command = self._ros.publisher(Topic(f"{self._arm}/servo_jp", JointState, NEWEST))
        reported_ns = looked_ns = time.monotonic_ns()
        for _ in control_periods():
            step = self._step(command.publish)
            if step.is_over:
                return step
            now_ns = time.monotonic_ns()
            if now_ns - looked_ns >= _LOOK_NS:
                looked_ns = now_ns
                others = self._other_senders(own=1)
                if others:
                    self._execution.end(Outcome.OTHER_SENDER, others)
            if now_ns - reported_ns >= _REPORT_NS:
                reported_ns = now_ns
                report(step)
        raise AssertionError("the periods do not end")

    def _wait_for_start(self) -> bool:
        """True when nothing forbids the motion, False when it is cancelled."""
        begin_ns = time.monotonic_ns()
        for _ in control_periods():
            waited_s = (time.monotonic_ns() - begin_ns) / NS_PER_S
            if self._cancelled.is_set():
                return False
            self._receive()
            problem = self._execution.problem(
                self._joints.measurement(), self._base.measurement(), self._clock_ns()
            )
            if not problem and waited_s >= LISTEN_S:
                break
            if waited_s > WAIT_S:
                senders = [*filter(None, [self._joints.problem(), self._base.problem()])]
                raise BridgeError("; ".join([problem, *senders]))
        others = self._other_senders(own=0)
        if others:
            raise BridgeError(others)
        return True

    def _other_senders(self, own: int) -> str:
        """Names the nodes that may move the arm if there are more than ``own``; else empty."""
        names = [f"{self._arm}/{each}" for each in MOTION]
        if sum(map(self._ros.node.count_publishers, names)) <= own:
            return ""
        infos = [
            each for name in names for each in self._ros.node.get_publishers_info_by_topic(name)
        ]
        return f"arm {self._arm}: {publishers_text(infos)} may move it; expected this one alone"

    def _step(self, send: Callable[[JointState], None]) -> ExecutionStep:
        """One period: read, decide, send. The command has the time after the reading."""
        if self._cancelled.is_set():
            self._execution.end(Outcome.CANCELLED, "cancelled by an operator")
        self._receive()
        joints, pose = self._joints.measurement(), self._base.measurement()
        now_ns = self._clock_ns()
        step = self._execution.step(joints, pose, now_ns)
        send(
            JointState(
                header=header_message("", Stamp(now_ns)),
                name=list(self._joint_names),
                position=step.positions.tolist(),
                velocity=step.velocities.tolist(),
            )
        )
        return step

    def _receive(self) -> None:
        """Use the constraints that have arrived, with their poses."""
        now_ns = self._clock_ns()
        for constraint, setup in self._constraints.arrived():
            self._execution.receive(constraint, now_ns)
            if self._execution.constraint is constraint:  # not a repeated or old one
                self._base.use(setup)

    def _cancel(self, _: Trigger.Request, response: Trigger.Response) -> None:
        self.cancel()
        response.success = True
