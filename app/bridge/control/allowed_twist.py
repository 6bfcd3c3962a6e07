"""``~/desired_twist`` to ``~/allowed_twist``: limit a velocity command by the constraint."""

import math
import threading
from collections import Counter
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import TwistStamped
from rclpy.serialization import serialize_message

from app.bridge import messages, topics
from app.bridge.control.twist_allowance import Allowance, TwistRefusedError, allowance_of
from app.bridge.heartbeat import steady_ns
from app.bridge.node import RosNode
from app.bridge.tf import TransformBuffer
from app.fixture import (
    Delay,
    LimiterParameters,
    MarginParameters,
    OwnMotion,
    limit_twist,
)
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    FloatArray,
    Freshness,
    FreshnessLimits,
    MarginGuardError,
    freshness_of,
)
from app.session import StepResult

FUTURE_TOLERANCE_NS = 5 * NS_PER_MS
"""Tolerated lead of a command's stamp, because the clocks of two hosts differ."""

_MAX_FRAME_CHARS = 256
"""Longer frame names are refused before they are processed."""

_COMMAND_AGE_NS = 100 * NS_PER_MS
_WATCH_NS = 5 * NS_PER_MS
"""Age of a command that is answered at most; interval at which the end of a reply is checked."""

_MAX_ATTEMPTS = 5
"""Computations of one reply while steps replace the constraint."""

_MAX_LOG_CHARS = 200
_LOG_INTERVAL_NS = NS_PER_S


@dataclass(frozen=True, slots=True, eq=False)
class _Answer:
    """The allowed ``twist`` (6,) by ``allowance``, valid until ``until_ns`` of the steady clock.

    ``in_tumor`` (6,) is the twist along the tumour's axes.
    """

    twist: FloatArray
    in_tumor: FloatArray
    allowance: Allowance
    until_ns: int


class TwistLimiter:
    """Replies to each command with the nearest twist that the constraint of the last step allows.

    A twist is the velocity of the tool's tip in m/s and the angular velocity in rad/s, along the
    axes of the frame in its header: the tumour's, or any that is connected with it. Edges that the
    session knows are those of the step, whatever others publish; ``buffer`` places only frames
    that the session does not know, from the one known frame that they are connected with. The
    reply has the header of the command.

    =================================================== ===========================================
    problem                                             reply
    =================================================== ===========================================
    poses recorded or simulated (``simulated``)         zero twist
    no step yet, or its planes belong to another pose   zero twist
    the step's data are too old                         zero twist
    not finite, older than 100 ms, from the future      zero twist
    frame unknown, or its transform stale or future     zero twist
    frame connected with several known frames           zero twist
    no command for ``timeout_ns``, or data too old      zero twist, repeated every ``timeout_ns``
    =================================================== ===========================================

    The planes are those of the poses of the step. What has been allowed since is subtracted from
    their clearances, as in `app.fixture.FixtureRule`: each reply is executed until the next one.
    Ages are checked again directly before a reply is sent, and after it: the process may have been
    stopped in between.

    `refused` counts each problem by kind; at most one per second is logged. A separate thread
    checks the timeout, so motion also stops while the node's thread is busy. It is ``tau_s`` by
    default: a reply that is executed for longer may pass a plane. With ``simulated`` every reply is
    zero: the poses are recorded or simulated, and the configuration does not accept such motion.
    """

    def __init__(
        self,
        ros: RosNode,
        buffer: TransformBuffer,
        *,
        parameters: LimiterParameters | None = None,
        timeout_ns: int | None = None,
        simulated: bool = False,
    ) -> None:
        self._ros = ros
        self._buffer = buffer
        self._parameters = parameters or LimiterParameters()
        tau_ns = round(self._parameters.tau_s * NS_PER_S)
        self._timeout_ns = tau_ns if timeout_ns is None else timeout_ns
        self._simulated = simulated
        self._lock = threading.Lock()
        self._publish_lock = threading.Lock()
        self._allowance: Allowance | None = None
        self._until_ns: int | None = None
        self._own = OwnMotion()
        self._lag_ns = round(self._parameters.tau_s * NS_PER_S / 2)
        self._commanded_ns: int | None = None
        self._has_begun = threading.Event()
        self._frame = ""
        self._logged_ns: int | None = None
        self.refused: Counter[str] = Counter()
        self._publisher = ros.publisher(topics.ALLOWED_TWIST)
        self._closing = threading.Event()
        self._watchdog = threading.Thread(target=self._watch, name="twist watchdog", daemon=True)
        ros.on_close(self.close)
        ros.subscribe(topics.DESIRED_TWIST, self._on_command)
        self._watchdog.start()

    def allow(
        self,
        step: StepResult,
        margins: MarginParameters,
        spent_ns: int = 0,
        since_ns: int | None = None,
    ) -> None:
        """Use the constraint of ``step``, made with ``margins``, until its data are stale.
        Thread-safe.

        ``spent_ns`` is the time from the moment when the step's frame was current until
        ``since_ns`` (of `steady_ns`, the present by default). A constraint whose planes belong to
        an earlier pose of the tool allows no motion.
        """
        begin_ns = (steady_ns() if since_ns is None else since_ns) - spent_ns
        allowance = allowance_of(step, margins, begin_ns, self._parameters)
        with self._publish_lock:  # after a reply that is being published
            self._allowance = allowance

    def forbid(self) -> None:
        """Allow no motion until the next `allow`: no such reply is sent afterwards. Thread-safe.

        What was allowed before is forgotten: another tumour may have other axes. So the constraint
        of poses from before allows none.
        """
        with self._publish_lock:
            self._allowance = None
            self._own.forget(steady_ns())

    def close(self) -> None:
        """Stop replying; the last reply is a zero twist. Closing the node destroys the endpoints.

        Destroying an endpoint while the node's thread waits for it would break the wait set.
        """
        if self._closing.is_set():
            return
        self._closing.set()
        self._has_begun.set()
        self._ros.remove_on_close(self.close)
        self._watchdog.join()
        with self._publish_lock:  # after a reply that is being published
            if self._commanded_ns is not None and self._ros.is_open:
                self._stop("closed")

    def _on_command(self, command: TwistStamped) -> None:
        if self._closing.is_set():
            return
        frame = command.header.frame_id
        self._frame = frame if len(frame) <= _MAX_FRAME_CHARS else ""
        self._commanded_ns = steady_ns()
        self._has_begun.set()
        answered = False
        try:
            # A step may replace the allowance while the twist is computed.
            for _ in range(_MAX_ATTEMPTS):
                answered = self._reply(command, self._allowed(command))
                if answered:
                    return
            raise TwistRefusedError("constraints replace each other too fast")
        except MarginGuardError as error:
            kind = error.kind if isinstance(error, TwistRefusedError) else type(error).__name__
            self._count(kind, str(error))
        with self._publish_lock:
            if not self._closing.is_set():
                self._send_zero(self._serialised(command.header.stamp, np.zeros(6)))

    def _reply(self, command: TwistStamped, answer: _Answer) -> bool:
        """Publish ``answer``; False if another step has replaced its allowance meanwhile.

        Raises `TwistRefusedError` if it is too late for it by now.
        """
        raw = self._serialised(command.header.stamp, answer.twist)
        zero = self._serialised(command.header.stamp, np.zeros(6))
        with self._publish_lock:
            if self._closing.is_set():
                return True
            if self._allowance is not answer.allowance:
                return False
            self._check_age(command)
            now_ns = steady_ns()
            if now_ns >= answer.until_ns:
                raise TwistRefusedError("the constraint is stale")
            # Counted before it is sent: sending may take long, and the robot moves meanwhile.
            self._own.command(answer.in_tumor, now_ns)
            self._until_ns = answer.until_ns
            self._publish(raw)
            if steady_ns() >= answer.until_ns:  # stopped while it was sent
                self._send_zero(zero)
        return True

    def _allowed(self, command: TwistStamped) -> _Answer:
        frame = command.header.frame_id
        if len(frame) > _MAX_FRAME_CHARS:
            detail = f"its name has {len(frame)} characters; expected at most {_MAX_FRAME_CHARS}"
            raise TwistRefusedError("frame of a command", detail)
        if self._simulated:
            detail = "limiter.accept_simulated in live.yaml is false"
            raise TwistRefusedError("the poses are recorded or simulated", detail)
        self._check_age(command)
        desired = _twist_of(command)
        allowance = self._allowance
        if allowance is None:
            raise TwistRefusedError("no constraint of now is known")
        if steady_ns() >= allowance.until_ns:
            raise TwistRefusedError("the constraint is stale")
        rotation, until_ns = allowance.rotation(frame, self._buffer)
        allowed = limit_twist(
            np.concatenate([rotation @ desired[:3], rotation @ desired[3:]]),
            allowance.constraint,
            allowance.tip_mm,
            allowance.parameters,
            self._delay(allowance),
        )
        twist = np.concatenate([rotation.T @ allowed[:3], rotation.T @ allowed[3:]])
        return _Answer(twist, allowed, allowance, until_ns)

    def _delay(self, allowance: Allowance) -> Delay:
        with self._publish_lock:
            now_ns = steady_ns()
            self._own.hold_until(now_ns)
            if not self._own.knows(allowance.poses_ns - self._lag_ns):
                raise TwistRefusedError("the constraint is stale")
            moved = self._own.since(
                allowance.poses_ns, self._lag_ns, now_ns, allowance.constraint, allowance.tip_mm
            )
        return Delay(moved, allowance.max_approach_mm_s, allowance.stale_after_ns / NS_PER_S)

    def _check_age(self, command: TwistStamped) -> None:
        stamp = command.header.stamp
        now_ns = self._ros.node.get_clock().now().nanoseconds
        limits = FreshnessLimits(
            max(self._timeout_ns, _COMMAND_AGE_NS), future_tolerance_ns=FUTURE_TOLERANCE_NS
        )
        freshness = freshness_of(messages.ns_of(stamp), now_ns, limits)
        if freshness is Freshness.FUTURE:
            raise TwistRefusedError("a command is from the future")
        if freshness is not Freshness.VALID:
            raise TwistRefusedError("a command is too old")

    def _watch(self) -> None:
        stopped_ns = 0
        self._has_begun.wait()  # before the first command there is no motion to stop
        while not self._closing.wait(min(self._timeout_ns, _WATCH_NS) / NS_PER_S):
            with self._publish_lock:  # no reply is sent meanwhile
                now_ns, commanded_ns, until_ns = steady_ns(), self._commanded_ns, self._until_ns
                assert commanded_ns is not None
                is_late = now_ns - commanded_ns >= self._timeout_ns
                if until_ns is not None and now_ns >= until_ns:
                    self._stop("the constraint is stale")
                elif is_late and now_ns - stopped_ns >= self._timeout_ns:
                    stopped_ns = now_ns
                    self._stop("no command comes any more")

    def _stop(self, reason: str) -> None:
        """Publish a zero twist; ``_publish_lock`` is held."""
        self._count(reason, reason)
        self._send_zero(self._serialised(self._ros.node.get_clock().now().to_msg(), np.zeros(6)))

    def _send_zero(self, raw: bytes) -> None:
        """Publish ``raw``, a zero twist; ``_publish_lock`` is held."""
        self._publish(raw)
        self._own.command(np.zeros(6), steady_ns())
        self._until_ns = None

    def _count(self, kind: str, reason: str) -> None:
        now_ns = steady_ns()
        with self._lock:
            self.refused[kind] += 1
            if self._logged_ns is not None and now_ns - self._logged_ns < _LOG_INTERVAL_NS:
                return
            self._logged_ns = now_ns
        self._ros.node.get_logger().warning(
            f"{topics.ALLOWED_TWIST.name}: {reason[:_MAX_LOG_CHARS]}"
        )

    def _serialised(self, stamp: object, twist: FloatArray) -> bytes:
        reply = TwistStamped()
        reply.header.stamp = stamp
        reply.header.frame_id = self._frame
        reply.twist.linear = messages.vector_message(messages.metres(twist[:3]))
        reply.twist.angular = messages.vector_message(twist[3:])
        return bytes(serialize_message(reply))

    def _publish(self, raw: bytes) -> None:
        self._publisher.publish(raw)


def _twist_of(command: TwistStamped) -> FloatArray:
    """Twist (6,): mm/s, then rad/s. Raises `TwistRefusedError` if it is not finite."""
    linear, angular = command.twist.linear, command.twist.angular
    values = [messages.MM_PER_M * value for value in (linear.x, linear.y, linear.z)]
    values += [angular.x, angular.y, angular.z]
    if not all(map(math.isfinite, values)):
        raise TwistRefusedError("a command is not finite")
    return np.array(values)
