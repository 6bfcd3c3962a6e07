"""Publish ``~/constraint`` at the control rate: serialise once, then change only ``seq``."""

import math
import secrets
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, Protocol

from builtin_interfaces.msg import Time
from marginguard_msgs.msg import FixtureConstraint, HalfSpace, StructureState
from rclpy.serialization import serialize_message

from app.bridge.constraint_message import split_at_seq
from app.bridge.heartbeat import Heartbeat
from app.bridge.messages import time_message
from app.bridge.ros_errors import BridgeError
from app.fixture import Reason, worst_first
from app.geometry import Stamp
from app.hold import HoldIdentity, NextHold, RandomBits, RearmRefusedError, SeenHold
from app.runtime import SWITCH_INTERVAL_S

_SEQ_MARK = 0x0123456789ABCDEF


class RawPublisher(Protocol):
    """Publisher of serialised messages, such as rclpy's."""

    def publish(self, raw: bytes) -> None:
        """Publish a serialised message."""


class RawConstraint(NamedTuple):
    """Bytes of a serialised constraint before and after its ``seq``."""

    before: bytes
    after: bytes

    @classmethod
    def of(cls, message: FixtureConstraint) -> "RawConstraint":
        """Serialise ``message``, overwriting its ``seq``; raises `BridgeError`."""
        message.seq = _SEQ_MARK
        before, seq, after = split_at_seq(serialize_message(message))
        if seq != _SEQ_MARK:
            raise BridgeError(f"serialised FixtureConstraint: expected seq at byte {len(before)}")
        return cls(before, after)

    def numbered(self, seq: int) -> bytes:
        """Bytes of the message with this ``seq``."""
        return self.before + seq.to_bytes(8, sys.byteorder) + self.after


class _ShortSwitches:
    """The interpreter's switch interval is short while any stream of the process needs it."""

    _lock = threading.Lock()
    _users = 0
    _usual_s = 0.0

    @classmethod
    def begin(cls) -> None:
        """Shorten it, unless another stream has."""
        with cls._lock:
            if cls._users == 0:
                cls._usual_s = sys.getswitchinterval()
                sys.setswitchinterval(min(cls._usual_s, SWITCH_INTERVAL_S))
            cls._users += 1

    @classmethod
    def end(cls) -> None:
        """Restore it after the last stream."""
        with cls._lock:
            cls._users -= 1
            if cls._users == 0:
                sys.setswitchinterval(cls._usual_s)


class ConstraintStream:
    """Publishes each constraint at once and repeats it at ``hz`` from a heartbeat thread.

    Repetition does not extend the validity: ``valid_until`` and the stamp stay those of the
    samples. ``hz`` None repeats nothing. A message that is sent with ``valid_ns`` is replaced by a
    ``stale`` one on hold after that time, in case the stepping thread is stuck while the heartbeat
    continues. This counts as a fault, which the next message does not clear (see `publish`).
    Without ``valid_ns`` only the receiver checks the validity, with ``valid_until``.

    The stream is the `app.hold.Holds` of a live session. It sets ``instance_id``, which is
    constant, and the ``rearm_nonce`` and ``hold_since`` of a `HoldIdentity`. A hold that begins
    with a stale message keeps both in the messages that follow.

    Above 100 Hz the interpreter's switch interval is 0.5 ms until the last such stream is closed
    (`sys.setswitchinterval`, for the whole process). With the default of 5 ms a busy thread would
    delay the heartbeat.
    """

    def __init__(
        self,
        publisher: RawPublisher,
        hz: float | None,
        *,
        random_bits: RandomBits = secrets.randbits,
        clock_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._publisher = publisher
        self.instance_id = f"{random_bits(64):016x}"
        self._identity = HoldIdentity(clock_ns, random_bits)
        self._replacement: NextHold | None = None
        self._last: FixtureConstraint | None = None
        self._fault_seq = 0
        self._heartbeat = Heartbeat(self._send, hz)
        self._is_fast = hz is not None and hz > 100.0
        if self._is_fast:
            _ShortSwitches.begin()

    def publish(
        self,
        message: FixtureConstraint,
        *,
        valid_ns: int | None = None,
        since_ns: int | None = None,
    ) -> bool:
        """Publish ``message`` now and repeat it; after ``valid_ns`` repeat it as stale and on hold.

        ``valid_ns`` is the time from ``since_ns`` (of `steady_ns`, now by default) to
        ``valid_until``, on the clock of the caller's stamps. It is None for a clock that can stop,
        such as that of a replay. After that time only the stale message is published.

        Returns False if the previous message had become stale or was followed by `hold`.
        ``message`` is then published on hold with the reason ``latched``, and the caller has to
        latch the hold in its own state.
        """
        faulty = message.state == FixtureConstraint.UNKNOWN
        begins = self._identity.is_new(_causes(message), faulty=faulty)
        if begins and not self._heartbeat.ended:
            self._identity.renew()
        self._identify(message)
        first = self._begin(message, valid_ns, since_ns, unless_ended=True)
        in_time = first is not None
        if not in_time:
            message.hold = True
            reasons = {*map(Reason, message.reasons), Reason.LATCHED}
            message.reasons = [str(reason) for reason in worst_first(reasons)]
            if self._replacement is None:
                self._identity.renew()
            else:  # published already, with the stale message
                self._identity.continue_with(self._replacement)
            begins = self._identity.is_new(_causes(message))
            if begins:  # the operator has not seen it with the stale message
                self._identity.renew()
            self._identify(message)
            first = self._begin(message, valid_ns, since_ns)
        if first is not None and begins:
            self._fault_seq = first
        self._identity.note(message.hold_causes, faulty=faulty)
        self._last = message
        return in_time

    def invalidate(self, message: FixtureConstraint) -> bool:
        """Replace the repeated message, whose planes are no longer valid, by an UNKNOWN one.

        Counts as a new fault: an acknowledgement of an earlier constraint cannot cover what
        follows. Returns False and publishes nothing if nothing is being repeated. Do not call
        this concurrently with `hold`.
        """
        if self._last is None:
            return False
        if self._heartbeat.ended:
            self._identity.renew()  # the next one has been published with the stale message
        self._identity.renew()
        self._identify(message)
        first = self._begin(message, None)
        self._fault_seq = self._fault_seq if first is None else first
        self._identity.note(message.hold_causes, faulty=True)
        self._last = message
        return True

    def latch(self, causes: Sequence[str]) -> None:
        """Repeat the last planes on hold until the next `publish`: a hold was latched between two.

        Counts as a new fault, as `invalidate` does. ``causes`` are all causes of the hold.
        """
        if self._last is not None:
            message = _held(self._last, str(Reason.STARTING))
            message.reasons = [str(Reason.STARTING), str(Reason.LATCHED)]
            message.hold_causes = list(causes)
            self.invalidate(message)

    def hold(self, reason: str) -> None:
        """Publish a last message on hold with ``reason``, then nothing until the next `publish`."""
        last = None
        if self._last is not None:
            if self._heartbeat.ended and self._replacement is not None:
                # The stale message has begun the hold.
                self._identity.since_ns = self._replacement.since_ns
            self._replacement = self._identity.next()
            last = self._raw_held(self._last, reason, self._replacement)
        self._last = None
        self._identity.forget_causes()
        self._heartbeat.pause(last)

    def close(self) -> None:
        """End the thread; nothing is sent afterwards."""
        try:
            self._heartbeat.close()
        finally:
            if self._is_fast:
                self._is_fast = False
                _ShortSwitches.end()

    def present(self) -> SeenHold:
        """The hold of the last constraint."""
        return SeenHold(max(0, self.seq - 1), self._identity.nonce)

    def check(self, seen: SeenHold) -> None:
        """Raise `RearmRefusedError` unless ``seen`` is the present hold.

        Also refused: a constraint before the last fault, one that was not published yet, and any
        while a stale constraint is repeated.
        """
        fault_seq = self.fault_seq
        if seen.seq < fault_seq:
            raise RearmRefusedError(
                f"seq is {seen.seq}: a fault began with constraint {fault_seq}, after it; expected "
                f"the seq of a constraint from {fault_seq} on"
            )
        if seen.seq >= self.seq:
            raise RearmRefusedError(
                f"seq is {seen.seq}: not published yet; expected at most {self.seq - 1}"
            )
        if self.ended:
            raise RearmRefusedError("the constraint is stale: its cause must end before re-arming")
        self._identity.check(seen.nonce)

    def consume(self, seen: SeenHold) -> None:
        """End the validity of the nonce of ``seen``."""
        self._identity.consume(seen.nonce)

    @property
    def seq(self) -> int:
        """Sequence number of the next message, which is the number of messages published."""
        return self._heartbeat.seq

    @property
    def missed(self) -> int:
        """Number of heartbeats that were skipped because they were late."""
        return self._heartbeat.missed

    @property
    def fault_seq(self) -> int:
        """Sequence number of the first message of the latest fault; 0 before any fault."""
        return max(self._fault_seq, self._heartbeat.ended_seq)

    @property
    def ended(self) -> bool:
        """True if the repeated message is stale or publishing has stopped (`hold`)."""
        return self._heartbeat.ended

    def _begin(
        self,
        message: FixtureConstraint,
        valid_ns: int | None,
        since_ns: int | None = None,
        *,
        unless_ended: bool = False,
    ) -> int | None:
        stale = None if valid_ns is None else self._identity.next(valid_ns)
        first = self._heartbeat.update(
            RawConstraint.of(message),
            valid_ns=valid_ns,
            since_ns=since_ns,
            # Serialised only when it is needed: few messages become stale.
            replacement=None if stale is None else partial(self._raw_held, message, "stale", stale),
            unless_ended=unless_ended,
        )
        if first is not None:
            self._replacement = stale
        return first

    def _identify(self, message: FixtureConstraint) -> None:
        """Set the instance, the nonce and the begin of the hold of ``message``."""
        message.instance_id = self.instance_id
        self._identity.follow(hold=message.hold, latched=Reason.LATCHED in message.reasons)
        since_ns = self._identity.since_ns
        message.hold_since = Time() if since_ns is None else time_message(Stamp(since_ns))
        message.rearm_nonce = self._identity.nonce

    def _raw_held(
        self, message: FixtureConstraint, reason: str, identity: NextHold
    ) -> RawConstraint:
        """``message`` on hold by a new fault."""
        held = _held(message, reason)
        held.instance_id = self.instance_id
        held.rearm_nonce = identity.nonce
        held.hold_since = time_message(Stamp(identity.since_ns))
        return RawConstraint.of(held)

    def _send(self, raw: RawConstraint, seq: int) -> None:
        self._publisher.publish(raw.numbered(seq))


def _causes(message: FixtureConstraint) -> Sequence[str]:
    """Causes of the hold of ``message``; empty without one."""
    return message.hold_causes if message.hold else ()


def _held(message: FixtureConstraint, reason: str) -> FixtureConstraint:
    """The same planes on hold, for a tumour at rest; every current measurement is NaN."""
    return FixtureConstraint(
        header=message.header,
        valid_until=message.valid_until,
        state=FixtureConstraint.UNKNOWN,
        reasons=[reason, *(known for known in message.reasons if known == "latched")],
        hold=True,
        hold_causes=[*message.hold_causes, f"the constraint is {reason}"],
        simulated=message.simulated,
        planes_current=False,
        single_source=message.single_source,
        half_spaces=[
            HalfSpace(normal=plane.normal, offset=plane.offset, point_on_tool=plane.point_on_tool)
            for plane in message.half_spaces
        ],
        signed_distance=math.nan,
        lower_bound=math.nan,
        stop_distance=math.nan,
        warn_distance=math.nan,
        sigma_tre=math.nan,
        max_tool_speed=message.max_tool_speed,
        max_tool_turn=message.max_tool_turn,
        model_id=message.model_id,
        registration_id=message.registration_id,
        setup_id=message.setup_id,
        tumor=message.tumor,
        base=message.base,
        structures=[
            StructureState(
                name=each.name,
                state=FixtureConstraint.UNKNOWN,
                signed_distance=math.nan,
                lower_bound=math.nan,
            )
            for each in message.structures
        ],
        half_space_structures=message.half_space_structures,
        off=message.off,
    )
