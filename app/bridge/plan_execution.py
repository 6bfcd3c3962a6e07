"""The ROS node that executes a planned motion of an arm with CRTK's topics, within the constraint.

========================== ===================================== ===================================
``/ARM/measured_js``       sensor_msgs/JointState                input: the joints
constraint, tracker        as of `app.bridge.arm_control`        input
``/ARM/servo_jp``          sensor_msgs/JointState                joint positions, 200 Hz, from the
                                                                 start of the motion on
`EXECUTED_PLAN`            std_msgs/String                       latched: the plan, while it runs
``~/cancel``               std_srvs/Trigger                      stop the motion for good
``~/execute``              marginguard_msgs/Execute              with `ExecutionServer`: a plan
========================== ===================================== ===================================
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from marginguard_msgs.action import Execute
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from app.bridge.arm_control import control_periods
from app.bridge.arm_inputs import BasePose, ConstraintInput, JointInput
from app.bridge.calls.action_server import ActionServer, GoalOutcome, ServedGoal
from app.bridge.calls.service_server import trigger_server
from app.bridge.messages import header_message
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.bridge.sender_names import publishers_text
from app.bridge.topics import EXECUTED_PLAN, MOTION, NEWEST, Topic
from app.control import (
    ControlDescription,
    ExecutionStep,
    Outcome,
    Plan,
    PlanExecution,
    parse_plan,
    positions_of,
)
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, Stamp

NODE_NAME = "marginguard_execute"

LISTEN_S, WAIT_S = 1.0, 5.0
"""Time for other nodes to appear, and longest wait for inputs that allow the start."""

END_S = 1.0
"""Longest wait for a request that ends, such as a cancelled one."""

_LOOK_NS = 100 * NS_PER_MS
"""Time between two looks for other senders."""


Watch = Callable[[FloatArray | None, float], str | None]
"""Takes positions (n,) on the path, None before the start, and the progress."""


class ExecutionNode:
    """Executes motions with the arm of ``description``. ``clock_ns`` is the host's clock.

    The publisher of its motion exists from the first one on.
    """

    def __init__(
        self, ros: RosNode, description: ControlDescription, *, clock_ns: Callable[[], int]
    ) -> None:
        self._ros, self._about, self._clock_ns = ros, description, clock_ns
        self._arm = description.arm
        self._command: Publisher | None = None
        self._joints = JointInput(ros, description.arm)
        self._base = BasePose(ros, description.tracker_topic, description.frame_from_base)
        self._constraints = ConstraintInput(ros, description.constraint_topic)
        self._cancelled = threading.Event()
        self._plans = ros.publisher(EXECUTED_PLAN)
        trigger_server(ros, "~/cancel", self.cancel)

    def allow(self) -> None:
        """Allow the next motion, which a cancel before it does not stop any more."""
        self._cancelled.clear()

    def is_cancelled(self) -> bool:
        """True from a cancel on, until the next motion is allowed."""
        return self._cancelled.is_set()

    def cancel(self) -> None:
        """Stop the motion within its accelerations, for good. Call it from any thread."""
        self._cancelled.set()

    def run(
        self,
        plan: Plan,
        report: Callable[[ExecutionStep], None],
        *,
        every_ns: int = NS_PER_S,
        watch: Watch = lambda positions, progress: "",
    ) -> ExecutionStep | None:
        """Execute ``plan`` and return its last step; None if cancelled before it began.

        ``report`` is called each ``every_ns``. Displays get the plan while it runs. ``watch`` is
        asked at each step: the motion brakes while it returns None, and stops for good for a text.
        Call it in one thread, once at a time. Raises `InputError` for a plan that is none for this
        arm, and `BridgeError` if it may not begin.
        """
        execution = PlanExecution(self._about, plan.motion)
        self._constraints.arrived()  # those before may be of a guard that has ended
        if not self._wait_for_start(execution, watch):
            return None
        self._plans.publish(String(data=plan.text))
        try:
            return self._execute(execution, report, every_ns, watch)
        finally:
            self._plans.publish(String())

    def _execute(
        self,
        execution: PlanExecution,
        report: Callable[[ExecutionStep], None],
        every_ns: int,
        watch: Watch,
    ) -> ExecutionStep:
        if self._command is None:
            topic = Topic(f"{self._arm}/servo_jp", JointState, NEWEST)
            self._command = self._ros.publisher(topic)
        reported_ns = looked_ns = time.monotonic_ns()
        verdict = watch(None, 0.0)
        for _ in control_periods():
            if verdict:
                execution.end(Outcome.OBSTACLE, verdict)
            step = self._step(execution, self._command, is_paused=verdict is None)
            verdict = watch(step.positions, step.progress)
            if step.is_over:
                return step
            now_ns = time.monotonic_ns()
            if now_ns - looked_ns >= _LOOK_NS:
                looked_ns = now_ns
                others = self._other_senders()
                if others:
                    execution.end(Outcome.OTHER_SENDER, others)
            if now_ns - reported_ns >= every_ns:
                reported_ns = now_ns
                report(step)
        raise AssertionError("the periods do not end")

    def now_ns(self) -> int:
        """The time on the clock of the stamps."""
        return self._clock_ns()

    def measured(self) -> FloatArray | None:
        """Positions (n,) of the arm's joints now; None if they cannot be used."""
        joints, max_age_ns = self._about.tool.joints, self._about.parameters.max_joints_age_ns
        return positions_of(self._joints.measurement(), joints, max_age_ns, self._clock_ns())

    def positions(self) -> dict[str, float]:
        """The joint positions now. Raises `BridgeError` if none arrive in `WAIT_S`."""
        begin_s = time.monotonic()
        for _ in control_periods():
            found = self.measured()
            if found is not None:
                return dict(zip(self._about.tool.joints, found.tolist(), strict=True))
            if time.monotonic() - begin_s > WAIT_S:
                max_age_ns = self._about.parameters.max_joints_age_ns
                problem = self._joints.problem() or f"joints of {self._arm}: no usable positions"
                raise BridgeError(
                    f"{problem}; expected all joints, at most {max_age_ns / NS_PER_MS:g} ms old"
                )
        raise AssertionError("the periods do not end")

    def _wait_for_start(self, execution: PlanExecution, watch: Watch) -> bool:
        """True when nothing forbids the motion, False when it is cancelled."""
        begin_ns = time.monotonic_ns()
        for _ in control_periods():
            waited_s = (time.monotonic_ns() - begin_ns) / NS_PER_S
            if self._cancelled.is_set():
                return False
            self._receive(execution)
            problem = execution.problem(
                self._joints.measurement(), self._base.measurement(), self._clock_ns()
            )
            verdict = watch(None, 0.0)
            if verdict:
                raise BridgeError(verdict)
            if verdict is None:
                problem = problem or "obstacles: the path is being tested; expected the result"
            if not problem and waited_s >= LISTEN_S:
                break
            if waited_s > WAIT_S:
                senders = [*filter(None, [self._joints.problem(), self._base.problem()])]
                raise BridgeError("; ".join([problem, *senders]))
        others = self._other_senders()
        if others:
            raise BridgeError(others)
        return True

    def _other_senders(self) -> str:
        """Names the nodes that may move the arm if this one is not alone; else empty."""
        own = int(self._command is not None)
        names = [f"{self._arm}/{each}" for each in MOTION]
        if sum(map(self._ros.node.count_publishers, names)) <= own:
            return ""
        infos = [
            each for name in names for each in self._ros.node.get_publishers_info_by_topic(name)
        ]
        return f"arm {self._arm}: {publishers_text(infos)} may move it; expected this one alone"

    def _step(
        self, execution: PlanExecution, command: Publisher, *, is_paused: bool
    ) -> ExecutionStep:
        """One period: read, decide, send. The command has the time after the reading."""
        if self._cancelled.is_set():
            execution.end(Outcome.CANCELLED, "cancelled by an operator")
        self._receive(execution)
        joints, pose = self._joints.measurement(), self._base.measurement()
        now_ns = self._clock_ns()
        step = execution.step(joints, pose, now_ns, time.monotonic_ns(), is_paused=is_paused)
        command.publish(
            JointState(
                header=header_message("", Stamp(now_ns)),
                name=list(self._about.tool.joints),
                position=step.positions.tolist(),
                velocity=step.velocities.tolist(),
            )
        )
        return step

    def _receive(self, execution: PlanExecution) -> None:
        """Use the constraints that have arrived, with their poses."""
        now_ns = self._clock_ns()
        for constraint, setup in self._constraints.arrived():
            execution.receive(constraint, now_ns)
            if execution.constraint is constraint:  # not a repeated or old one
                self._base.use(setup)


@contextmanager
def alone(lock: threading.Lock) -> Iterator[None]:
    """Hold ``lock``; raises `BridgeError` if another request holds it for longer than `END_S`."""
    if not lock.acquire(timeout=END_S):
        raise BridgeError("another request is being served; expected one after the other")
    try:
        yield
    finally:
        lock.release()


class ExecutionServer:
    """Serves the action ``~/execute`` with ``node``, and others that move it, until ``ros`` closes.

    A plan is executed with ``lock`` held, and refused while another request holds it. ``watch`` of
    a plan is that of `ExecutionNode.run`.
    """

    def __init__(
        self,
        ros: RosNode,
        node: ExecutionNode,
        lock: threading.Lock,
        watch: Callable[[Plan], Watch],
    ) -> None:
        self._ros, self._node, self._lock, self._watch = ros, node, lock, watch
        self._servers: list[ActionServer] = []
        self.serve(Execute, "~/execute", self._run)

    def serve(
        self,
        action: type,
        name: str,
        run: Callable[[ServedGoal], tuple[Any, GoalOutcome]],
    ) -> None:
        """Serve an action whose ``run`` moves the arm; its goal is rejected while another is."""
        self._servers.append(ActionServer(self._ros, action, name, run, check=self._check))

    def _check(self, _: object) -> None:
        if any(each.is_active for each in self._servers):
            raise BridgeError("another goal moves the arm; expected one after the other")
        self._node.allow()  # where the goal is accepted, so that a cancel after that is not lost

    def _run(self, served: ServedGoal) -> tuple[Execute.Result, GoalOutcome]:
        with alone(self._lock):
            served.on_cancel(self._node.cancel)
            plan = parse_plan(served.request.plan)
            last = self._node.run(
                plan,
                lambda step: served.feedback(Execute.Feedback(progress=step.progress)),
                watch=self._watch(plan),
            )
        if last is None:
            result = Execute.Result(message="cancelled before it began")
            return result, GoalOutcome.CANCELLED
        arrived = last.outcome is Outcome.ARRIVED
        result = Execute.Result(
            success=arrived,
            message="" if arrived else last.text,
            outcome=str(last.outcome),
            progress=last.progress,
        )
        if last.outcome is Outcome.CANCELLED:
            return result, GoalOutcome.CANCELLED
        return result, GoalOutcome.SUCCEEDED if arrived else GoalOutcome.ABORTED
