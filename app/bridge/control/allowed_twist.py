"""``~/desired_twist`` to ``~/allowed_twist``: a velocity through the fixture, answered at once."""

import math
import threading
import time
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from geometry_msgs.msg import TwistStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from app.bridge import messages, topics
from app.bridge.errors import BridgeError
from app.bridge.node import RosNode
from app.bridge.tf import TransformBuffer
from app.bridge.tf.errors import TfError
from app.fixture import Constraint, LimiterParameters, limit_twist
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, MarginGuardError
from app.session import StepResult

_MOST_FUTURE_NS = 5 * NS_PER_MS
"""How far clocks of two hosts may be apart before a command is one from the future."""


class TwistRefusedError(BridgeError):
    """A command that cannot be brought through the fixture; the answer is no motion."""


@dataclass(frozen=True, slots=True, eq=False)
class _Allowance:
    """What the last step allows a tool whose origin is at ``tip_mm`` (3,), in the tumour's frame.

    ``until_ns`` is on the monotonic clock, ``stamp_ns`` the tracker's time of the oldest sample.
    """

    constraint: Constraint
    tip_mm: FloatArray
    stamp_ns: int
    stale_after_ns: int
    until_ns: int


class TwistLimiter:
    """Answers each command with the nearest one that the constraint of the last step allows.

    A twist is the velocity of the tool's tip in m/s and the angular velocity in rad/s, along the
    axes of the frame that its header names: the tumour's, or any that ``buffer`` knows a way to.
    The answer has the header of the command.

    =============================================== ===============================
    what is wrong                                   the answer
    =============================================== ===============================
    the step's data are too old                     no approach, retreat as wanted
    no step yet, or none that knew the tool         no motion
    not finite, older than ``timeout_ns``, future   no motion
    frame unknown, or its way stale                 no motion
    no command for ``timeout_ns``                   no motion, said every ``timeout_ns``
    =============================================== ===============================

    Each is counted in `refused`, and said in the log when it is another than the last.
    """

    def __init__(
        self,
        ros: RosNode,
        buffer: TransformBuffer,
        *,
        parameters: LimiterParameters | None = None,
        timeout_ns: int = 100 * NS_PER_MS,
    ) -> None:
        self._ros = ros
        self._buffer = buffer
        self._parameters = parameters or LimiterParameters()
        self._timeout_ns = timeout_ns
        self._lock = threading.Lock()
        self._allowance: _Allowance | None = None
        self._commanded_ns: int | None = None
        self._frame = ""
        self._said = ""
        self.refused: Counter[str] = Counter()
        self._publisher = ros.publisher(topics.ALLOWED_TWIST)
        self._closed = False
        ros.subscribe(topics.DESIRED_TWIST, self._take)
        ros.node.create_timer(
            timeout_ns / NS_PER_S, self._watch, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def allow(self, step: StepResult, stale_after_ns: int) -> None:
        """Take over what ``step`` allows, as long as its data are not too old; from any thread."""
        decision, pose = step.decision, step.tumor_from_tip
        with self._lock:
            if decision.constraint is None:
                self._allowance = None
            elif pose is not None and decision.stamp is not None:
                left_ns = stale_after_ns - decision.stamp.age_ns(step.frame.stamp)
                self._allowance = _Allowance(
                    constraint=decision.constraint,
                    tip_mm=pose.translation_mm,
                    stamp_ns=decision.stamp.ns,
                    stale_after_ns=stale_after_ns,
                    until_ns=time.monotonic_ns() + left_ns,
                )
            elif self._allowance is not None:
                # The tool is not seen: of it nothing is known but where it was.
                self._allowance = replace(self._allowance, until_ns=time.monotonic_ns())

    def close(self) -> None:
        """Answer no more; the last answer is no motion. The topics go with the node.

        An endpoint that is destroyed while the node's thread waits for it would break its wait.
        """
        self._closed = True
        if self._commanded_ns is not None and self._ros.is_open:
            self._stop("closed")

    def _take(self, command: TwistStamped) -> None:
        if self._closed:
            return
        self._commanded_ns = time.monotonic_ns()
        self._frame = command.header.frame_id
        try:
            twist = self._allowed(command)
        except MarginGuardError as error:
            self._count(str(error))
            twist = np.zeros(6)
        else:
            self._said = ""
        self._publish(command.header.stamp, twist)

    def _allowed(self, command: TwistStamped) -> FloatArray:
        self._check_age(command)
        desired = _twist_of(command)
        with self._lock:
            allowance = self._allowance
        if allowance is None:
            raise TwistRefusedError("no constraint is known yet")
        rotation = self._rotation(allowance, self._frame)
        constraint = allowance.constraint
        if time.monotonic_ns() >= allowance.until_ns:
            self._count("the constraint is stale")
            constraint = constraint.held()
        allowed = limit_twist(
            np.concatenate([rotation @ desired[:3], rotation @ desired[3:]]),
            constraint,
            allowance.tip_mm,
            self._parameters,
        )
        return np.concatenate([rotation.T @ allowed[:3], rotation.T @ allowed[3:]])

    def _check_age(self, command: TwistStamped) -> None:
        stamp = command.header.stamp
        now_ns = self._ros.node.get_clock().now().nanoseconds
        age_ns = now_ns - (stamp.sec * NS_PER_S + stamp.nanosec)
        if age_ns > self._timeout_ns:
            raise TwistRefusedError("a command is too old")
        if age_ns < -_MOST_FUTURE_NS:
            raise TwistRefusedError("a command is from the future")

    def _rotation(self, allowance: _Allowance, frame: str) -> FloatArray:
        """``tumor_from_frame``'s rotation, (3, 3)."""
        tumor = allowance.constraint.frame
        if frame == tumor:
            return np.eye(3)
        try:
            found = self._buffer.lookup(tumor, frame)
        except TfError as error:
            raise TwistRefusedError(f"frame of a command: {error}") from error
        if found.stamp_ns is not None:
            age_ns = allowance.stamp_ns - found.stamp_ns
            if age_ns > allowance.stale_after_ns:
                raise TwistRefusedError(f"the way from {tumor!r} to {frame!r} is stale")
        return found.transform.rotation

    def _watch(self) -> None:
        if self._commanded_ns is None or self._closed:
            return
        if time.monotonic_ns() - self._commanded_ns >= self._timeout_ns:
            self._stop("no command comes any more")

    def _stop(self, reason: str) -> None:
        self._count(reason)
        self._publish(self._ros.node.get_clock().now().to_msg(), np.zeros(6))

    def _count(self, reason: str) -> None:
        self.refused[reason.partition(":")[0]] += 1
        if reason != self._said:
            self._said = reason
            self._ros.node.get_logger().warning(f"{topics.ALLOWED_TWIST.name}: {reason}")

    def _publish(self, stamp: object, twist: FloatArray) -> None:
        answer = TwistStamped()
        answer.header.stamp = stamp
        answer.header.frame_id = self._frame
        answer.twist.linear = messages.vector_message(messages.metres(twist[:3]))
        answer.twist.angular = messages.vector_message(twist[3:])
        self._publisher.publish(answer)


def _twist_of(command: TwistStamped) -> FloatArray:
    """(6,): mm/s, then rad/s."""
    linear, angular = command.twist.linear, command.twist.angular
    values = [messages.MM_PER_M * value for value in (linear.x, linear.y, linear.z)]
    values += [angular.x, angular.y, angular.z]
    if not all(map(math.isfinite, values)):
        raise TwistRefusedError("a command is not finite")
    return np.array(values)
