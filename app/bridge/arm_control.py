"""The ROS node of a cooperative controller, between a hand and an arm with CRTK's topics.

============================== ============================== ===================================
``/ARM/measured_js``           sensor_msgs/JointState         input: the joints
``/ARM/body/measured_cf``      geometry_msgs/WrenchStamped    input: the hand's wrench, or another
                                                              topic
``/marginguard/constraint``    marginguard_msgs/              input: the guard's constraint
                               FixtureConstraint
``/tracked_transforms``        marginguard_msgs/              input: the frame of the tumour, and
                               TrackedTransform               the one that the base is registered in
``/ARM/servo_jv``              sensor_msgs/JointState         joint velocities, 200 Hz; or, with
                                                              ``impedance``, `ImpedanceOutput`
``~/rearm``                    std_srvs/Trigger               end the stop of the watchdog
``/diagnostics``               DiagnosticArray                why the arm stands, and how often it
                                                              was stopped
============================== ============================== ===================================

Every input but the constraint has to have a single sender; the rule judges that of the constraint.
"""

import threading
import time
from array import array
from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Quaternion
from rclpy.publisher import Publisher
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from app.bridge import topics
from app.bridge.arm_inputs import BasePose, ConstraintInput, JointInput, WrenchInput
from app.bridge.calls.service_server import trigger_server
from app.bridge.convert.plain import message_type
from app.bridge.messages import (
    diagnostic_status,
    header_message,
    metres,
    time_message,
    vector_message,
)
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError, CallError, UnknownTypeError
from app.bridge.topics import NEWEST, Topic
from app.control import (
    BASE,
    RULE_FRAME,
    ControlDecision,
    ControlDescription,
    ControlReason,
    HalfAxis,
    ImpedanceParameters,
    JointMeasurement,
    PoseMeasurement,
    WrenchMeasurement,
    half_axis,
)
from app.fixture import MarginState, PlainConstraint
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, Stamp, Transform

PAUSE_PERIOD_NS = 100 * NS_PER_MS

NODE_NAME = "marginguard_control"
PERIOD_NS = 5 * NS_PER_MS
MAX_SILENCE_NS = 100 * NS_PER_MS
"""Without a constraint for as long there is no guard that an operator could re-arm for."""

_WARM_UP_STEPS = 3
_FAR_MM = 1e4

_REPORT_NS = NS_PER_S
_MIN_REPORT_NS = 100 * NS_PER_MS


def control_periods() -> Iterator[bool]:
    """Yield at each control period; True for one that begins more than a period late."""
    due_ns, is_late = time.monotonic_ns(), False
    while True:
        yield is_late
        due_ns += PERIOD_NS
        ahead_ns = due_ns - time.monotonic_ns()
        is_late = ahead_ns < -PERIOD_NS
        if ahead_ns > 0:
            time.sleep(ahead_ns / NS_PER_S)
        elif is_late:
            due_ns = time.monotonic_ns()


class ImpedanceOutput:
    """Publishes the constraint as CRTK's ``servo_ci``: the arm closes the loop itself (dVRK).

    ====================== ============================= ==========================================
    ``ARM/servo_ci``       crtk_msgs/CartesianImpedance  a stiff half-axis along the plane's normal
    ``ARM/state_command``  crtk_msgs/StringStamped       ``pause``, repeated while nothing is
                                                         allowed
    ====================== ============================= ==========================================

    The root link of ``arm`` is ``frame``. ``servo_ci`` has no expiry: an arm keeps the last one. So
    an arm that must not move freely is sent ``pause``. `resume` is a request of the arm's operator
    alone and is never sent.

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


class ControlNode:
    """Moves the arm of ``description`` by the hand, within the guard's constraint.

    ``clock_ns`` is the clock of all stamps: the host's. ``stops`` counts how often an arm that
    followed the hand had to stand or was on retreat only, by reason; ``watchdog_stops`` the latched
    ones among them.
    """

    def __init__(
        self, ros: RosNode, description: ControlDescription, *, clock_ns: Callable[[], int]
    ) -> None:
        self._description, self._clock_ns, self._ros = description, clock_ns, ros
        _warm_up(description)
        self._controller = description.controller()
        self._joints = JointInput(ros, description.arm)
        self._wrench = WrenchInput(ros, description.hand_topic, in_tool=description.hand_in_tool)
        self._base = BasePose(ros, description.tracker_topic, description.frame_from_base)
        self._constraints = ConstraintInput(ros, description.constraint_topic)
        self._command: Publisher | None = None
        self._message = JointState(name=list(description.tool.joints))
        self._impedance: ImpedanceOutput | None = None
        if description.impedance is None:
            self._command = ros.publisher(Topic(f"{description.arm}/servo_jv", JointState, NEWEST))
        else:
            self._impedance = ImpedanceOutput(
                ros, description.arm, description.tool.base, description.impedance
            )
        self._newest: PlainConstraint | None = None
        self._diagnostics = ros.publisher(topics.DIAGNOSTICS)
        self._lock = threading.Lock()
        self._constraint_ns: int | None = None
        self._last: ControlDecision | None = None
        self._reported: tuple[object, ...] = ()
        self._logged: ControlReason | None = None
        self._reported_ns: int | None = None
        self.stops: Counter[str] = Counter()
        self.watchdog_stops = 0
        self.late_steps = 0
        """Control steps that began more than a period late."""
        trigger_server(ros, "~/rearm", self._rearm)

    def run(self, stop: threading.Event) -> None:
        """Step until ``stop``; the last command is 0."""
        try:
            for is_late in control_periods():
                self.late_steps += is_late
                if stop.is_set():
                    break
                self.step()
        finally:
            self._send(np.zeros(len(self._description.tool.joints)), self._clock_ns())
            if self._impedance is not None:
                self._impedance.pause(self._clock_ns(), at_once=True)

    def step(self) -> ControlDecision:
        """One control step: read, decide, send. The command has the time after the reading."""
        constraints = self._constraints.arrived()
        with self._lock:
            now_ns = self._clock_ns()
            was_latched = self._controller.latched
            for constraint, setup in constraints:
                self._constraint_ns = now_ns
                self._controller.receive(constraint, now_ns)
                self._newest = constraint
                if self._controller.constraint is constraint:  # not a repeated or old one
                    self._base.use(setup)
            joints, wrench = self._joints.measurement(), self._wrench.measurement()
            pose = self._base.measurement()
            now_ns = self._clock_ns()
            if self._impedance is not None:  # the arm feels the hand, nothing else does
                wrench = WrenchMeasurement(now_ns, np.zeros(3), np.zeros(3))
            decision = self._controller.step(joints, wrench, pose, now_ns)
            self.watchdog_stops += self._controller.latched and not was_latched
            self._send(decision.velocities, now_ns)
            if self._impedance is not None:
                self._send_impedance(self._impedance, decision, joints, pose, now_ns)
            follows = ControlReason.FOLLOWS
            if self._last is not None and self._last.reason is follows is not decision.reason:
                self.stops[_text(decision)] += 1
            self._last = decision
        self._report(decision, now_ns)
        return decision

    def problems(self) -> list[str]:
        """Inputs that have more than one sender, with the names of their nodes."""
        inputs = self._joints, self._wrench, self._base
        return [text for each in inputs if (text := each.problem())]

    def _send_impedance(
        self,
        output: ImpedanceOutput,
        decision: ControlDecision,
        joints: JointMeasurement | None,
        pose: PoseMeasurement | None,
        now_ns: int,
    ) -> None:
        """Publish the nearest plane where the rule allows motion, and pause the arm elsewhere."""
        allowed = decision.reason is ControlReason.FOLLOWS
        if not allowed or joints is None or pose is None or self._newest is None:
            output.pause(now_ns)
            return
        tool = self._description.tool
        named = dict(zip(joints.names, joints.positions, strict=True))
        base_from_tip, _ = tool.evaluate(np.array([named[each] for each in tool.joints]))
        axis = half_axis(self._newest, pose.rule_from_base, base_from_tip.translation_mm)
        output.publish(axis, now_ns)

    def _send(self, velocities: FloatArray, now_ns: int) -> None:
        if self._command is None:
            return
        self._message.header.stamp = time_message(Stamp(now_ns))
        self._message.velocity = array("d", velocities.tobytes())
        self._command.publish(self._message)

    def _rearm(self) -> None:
        """End the latched stop, at the request of the controller's operator."""
        with self._lock:
            now_ns, last_ns = self._clock_ns(), self._constraint_ns
            if last_ns is None or not 0 <= now_ns - last_ns <= MAX_SILENCE_NS:
                raise CallError(
                    f"{self._description.constraint_topic}: no constraint arrives; expected a "
                    "running guard before re-arming"
                )
            self._controller.rearm()
        self._ros.node.get_logger().warning("re-armed by an operator")

    def _report(self, decision: ControlDecision, now_ns: int) -> None:
        """Publish diagnostics at each change, at most 10 times per second, and each second."""
        state = (decision.reason, decision.rule, self._controller.latched)
        elapsed_ns = _REPORT_NS if self._reported_ns is None else now_ns - self._reported_ns
        is_due = elapsed_ns >= (_REPORT_NS if state == self._reported else _MIN_REPORT_NS)
        if not is_due and elapsed_ns >= 0:
            return
        self._reported, self._reported_ns = state, now_ns
        self._log(decision)
        problems = self.problems()
        is_stopped = self._controller.latched or bool(problems)
        level = DiagnosticStatus.ERROR if is_stopped else DiagnosticStatus.WARN
        if decision.reason is ControlReason.FOLLOWS:
            level = DiagnosticStatus.OK
        values = {
            "latched": str(self._controller.latched).lower(),
            "watchdog_stops": self.watchdog_stops,
            "late_steps": self.late_steps,
            **{f"stops: {text}": count for text, count in sorted(self.stops.items())},
        }
        text, arm = "; ".join([_text(decision), *problems]), self._description.arm
        status = diagnostic_status(f"control {arm}", level, text, values, arm)
        header = header_message("", Stamp(now_ns))
        self._diagnostics.publish(DiagnosticArray(header=header, status=[status]))

    def _log(self, decision: ControlDecision) -> None:
        """Log a change of the reason; a latched stop once, whatever its cause is by now."""
        reason = decision.reason
        if reason is self._logged:
            return
        self._logged = reason
        if reason is ControlReason.WATCHDOG:
            cause = decision.rule or "no constraint"
            self._ros.node.get_logger().error(
                f"stopped and latched ({cause}): 'marginguard control --rearm' ends it"
            )
        else:
            self._ros.node.get_logger().info(_text(decision))


def _text(decision: ControlDecision) -> str:
    """The reason of ``decision``, with that of the rule where it decided."""
    is_rule = decision.reason in (ControlReason.RULE, ControlReason.WATCHDOG)
    shown = is_rule and decision.rule is not None
    return f"{decision.reason}: {decision.rule}" if shown else str(decision.reason)


def _warm_up(description: ControlDescription) -> None:
    """Take some steps of a controller of its own, whose decisions nothing uses.

    The first step of a process takes most of a second, in which a constraint would expire.
    """
    controller = description.controller()
    joints = description.tool.joints
    identity = Transform.identity(RULE_FRAME, BASE)
    for number in range(_WARM_UP_STEPS):
        now_ns = (number + 1) * NS_PER_MS
        planes = np.array([[0.0, 0.0, 1.0]])
        constraint = PlainConstraint(
            "warm-up", number, RULE_FRAME, now_ns, now_ns + NS_PER_MS, int(MarginState.NEGATIVE),
            False, description.accept_simulated, True, planes, np.array([-_FAR_MM]),
            np.zeros((1, 3)), np.zeros((1, 3)), _FAR_MM, 1.0, 1.0, 1.0, "warm-up",
        )  # fmt: skip
        controller.receive(constraint, now_ns)
        controller.step(
            JointMeasurement(now_ns, joints, (0.0,) * len(joints)),
            WrenchMeasurement(now_ns, np.ones(3), np.zeros(3)),
            PoseMeasurement(now_ns, identity),
            now_ns,
        )
