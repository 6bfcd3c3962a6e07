"""``~/desired_twist`` to ``~/allowed_twist``: a velocity through the fixture, answered at once."""

import math
import threading
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import TwistStamped

from app.bridge import messages, topics
from app.bridge.errors import BridgeError
from app.bridge.node import RosNode
from app.bridge.tf import TransformBuffer
from app.bridge.tf.errors import TfError
from app.fixture import Constraint, LimiterParameters, limit_twist
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    FloatArray,
    Freshness,
    FreshnessLimits,
    MarginGuardError,
    freshness_of,
    freshness_of_stamp,
    stale_in_ns,
)
from app.session import StepResult

FUTURE_TOLERANCE_NS = 5 * NS_PER_MS
"""How far a command's stamp may be ahead: its sender may be another host, whose clock differs."""

_MOST_LETTERS = 256
"""Of a frame's name: longer ones are refused before anything else is done with them."""

_MOST_WORDS = 200
_SAY_AGAIN_NS = NS_PER_S


class TwistRefusedError(BridgeError):
    """A command that cannot be brought through the fixture; the answer is no motion.

    ``kind`` is one of a few: what came over the network is in ``detail`` alone.
    """

    def __init__(self, kind: str, detail: str = "") -> None:
        self.kind = kind
        super().__init__(f"{kind}: {detail}" if detail else kind)


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
    no step yet, or its planes are not of its pose  no motion
    the step's data have become too old since       no motion
    not finite, older than ``timeout_ns``, future   no motion
    frame unknown, or its way stale or future       no motion
    no command for ``timeout_ns``                   no motion, said every ``timeout_ns``
    =============================================== ===============================

    Each is counted by its kind in `refused`; the log has one line a second at most. The time-out
    is watched in a thread of its own: it also ends motion while the node's thread is at something
    else.
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
        self._speaking = threading.Lock()
        self._allowance: _Allowance | None = None
        self._commanded_ns: int | None = None
        self._frame = ""
        self._said_ns: int | None = None
        self.refused: Counter[str] = Counter()
        self._publisher = ros.publisher(topics.ALLOWED_TWIST)
        self._closing = threading.Event()
        self._watchdog = threading.Thread(target=self._watch, name="twist watchdog", daemon=True)
        ros.on_close(self.close)
        ros.subscribe(topics.DESIRED_TWIST, self._take)
        self._watchdog.start()

    def allow(self, step: StepResult, stale_after_ns: int, spent_ns: int = 0) -> None:
        """Take over what ``step`` allows, as long as its data are not too old; from any thread.

        ``spent_ns``: how long ago its frame was the present. Planes of an earlier step say nothing
        about the tool where it is now: they allow nothing.
        """
        allowance = _allowance_of(step, stale_after_ns, spent_ns)
        with self._lock:
            self._allowance = allowance

    def forbid(self) -> None:
        """Allow nothing up to the next `allow`; from any thread."""
        with self._lock:
            self._allowance = None

    def close(self) -> None:
        """Answer no more; the last answer is no motion. The topics go with the node.

        An endpoint that is destroyed while the node's thread waits for it would break its wait.
        """
        if self._closing.is_set():
            return
        self._closing.set()
        self._ros.not_on_close(self.close)
        self._watchdog.join()
        with self._speaking:  # after an answer that is on its way
            if self._commanded_ns is not None and self._ros.is_open:
                self._stop("closed")

    def _take(self, command: TwistStamped) -> None:
        if self._closing.is_set():
            return
        frame = command.header.frame_id
        self._frame = frame if len(frame) <= _MOST_LETTERS else ""
        self._commanded_ns = time.monotonic_ns()
        try:
            twist = self._allowed(command)
        except MarginGuardError as error:
            kind = error.kind if isinstance(error, TwistRefusedError) else type(error).__name__
            self._count(kind, str(error))
            twist = np.zeros(6)
        with self._speaking:
            if not self._closing.is_set():
                self._publish(command.header.stamp, twist)

    def _allowed(self, command: TwistStamped) -> FloatArray:
        frame = command.header.frame_id
        if len(frame) > _MOST_LETTERS:
            detail = f"its name has {len(frame)} letters: {_MOST_LETTERS} allowed"
            raise TwistRefusedError("frame of a command", detail)
        self._check_age(command)
        desired = _twist_of(command)
        with self._lock:
            allowance = self._allowance
        if allowance is None:
            raise TwistRefusedError("no constraint of now is known")
        if time.monotonic_ns() >= allowance.until_ns:
            raise TwistRefusedError("the constraint is stale")
        rotation = self._rotation(allowance, frame)
        allowed = limit_twist(
            np.concatenate([rotation @ desired[:3], rotation @ desired[3:]]),
            allowance.constraint,
            allowance.tip_mm,
            self._parameters,
        )
        return np.concatenate([rotation.T @ allowed[:3], rotation.T @ allowed[3:]])

    def _check_age(self, command: TwistStamped) -> None:
        stamp = command.header.stamp
        now_ns = self._ros.node.get_clock().now().nanoseconds
        limits = FreshnessLimits(self._timeout_ns, future_tolerance_ns=FUTURE_TOLERANCE_NS)
        freshness = freshness_of(stamp.sec * NS_PER_S + stamp.nanosec, now_ns, limits)
        if freshness is Freshness.FUTURE:
            raise TwistRefusedError("a command is from the future")
        if freshness is not Freshness.VALID:
            raise TwistRefusedError("a command is too old")

    def _rotation(self, allowance: _Allowance, frame: str) -> FloatArray:
        """``tumor_from_frame``'s rotation, (3, 3), at the time of the planes or before it."""
        tumor = allowance.constraint.frame
        if frame == tumor:
            return np.eye(3)
        try:
            found = self._buffer.lookup(tumor, frame)
            if found.stamp_ns is None:  # static edges alone, which hold at any time
                return found.transform.rotation
            # The planes may be up to the limit old while tf goes on, so its newest pose may be as
            # far ahead of them. Then the pose at the time of the planes is used instead.
            limits = FreshnessLimits(
                allowance.stale_after_ns, future_tolerance_ns=allowance.stale_after_ns
            )
            freshness = freshness_of(found.stamp_ns, allowance.stamp_ns, limits)
            if freshness is not Freshness.VALID:
                late = "from the future" if freshness is Freshness.FUTURE else "stale"
                raise TwistRefusedError("way to the frame of a command", f"{frame!r} is {late}")
            if found.stamp_ns > allowance.stamp_ns:
                found = self._buffer.lookup(tumor, frame, allowance.stamp_ns)
        except TfError as error:
            raise TwistRefusedError("frame of a command", str(error)) from error
        return found.transform.rotation

    def _watch(self) -> None:
        while not self._closing.wait(self._timeout_ns / NS_PER_S):
            commanded_ns = self._commanded_ns
            if commanded_ns is None:
                continue
            if time.monotonic_ns() - commanded_ns >= self._timeout_ns:
                self._stop("no command comes any more")

    def _stop(self, reason: str) -> None:
        self._count(reason, reason)
        self._publish(self._ros.node.get_clock().now().to_msg(), np.zeros(6))

    def _count(self, kind: str, words: str) -> None:
        now_ns = time.monotonic_ns()
        with self._lock:
            self.refused[kind] += 1
            if self._said_ns is not None and now_ns - self._said_ns < _SAY_AGAIN_NS:
                return
            self._said_ns = now_ns
        self._ros.node.get_logger().warning(f"{topics.ALLOWED_TWIST.name}: {words[:_MOST_WORDS]}")

    def _publish(self, stamp: object, twist: FloatArray) -> None:
        answer = TwistStamped()
        answer.header.stamp = stamp
        answer.header.frame_id = self._frame
        answer.twist.linear = messages.vector_message(messages.metres(twist[:3]))
        answer.twist.angular = messages.vector_message(twist[3:])
        self._publisher.publish(answer)


def _allowance_of(step: StepResult, stale_after_ns: int, spent_ns: int) -> _Allowance | None:
    """None where the step has no planes of the place that the tool has in it."""
    decision, pose = step.decision, step.tumor_from_tip
    constraint, stamp = decision.constraint, decision.stamp
    if constraint is None or not decision.constraint_is_current or stamp is None or pose is None:
        return None
    limits, now = FreshnessLimits(stale_after_ns), step.frame.stamp
    if freshness_of_stamp(stamp, now, limits) is not Freshness.VALID:
        return None
    return _Allowance(
        constraint=constraint,
        tip_mm=pose.translation_mm,
        stamp_ns=stamp.ns,
        stale_after_ns=stale_after_ns,
        until_ns=time.monotonic_ns() + stale_in_ns(stamp.ns, now.ns, limits) - spent_ns,
    )


def _twist_of(command: TwistStamped) -> FloatArray:
    """(6,): mm/s, then rad/s."""
    linear, angular = command.twist.linear, command.twist.angular
    values = [messages.MM_PER_M * value for value in (linear.x, linear.y, linear.z)]
    values += [angular.x, angular.y, angular.z]
    if not all(map(math.isfinite, values)):
        raise TwistRefusedError("a command is not finite")
    return np.array(values)
