"""Publish ``~/constraint`` at the control rate: serialise once, then change only ``seq``."""

import math
import secrets
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, Protocol

from builtin_interfaces.msg import Time
from marginguard_msgs.msg import FixtureConstraint, HalfSpace
from rclpy.serialization import serialize_message

from app.bridge.errors import BridgeError
from app.bridge.heartbeat import Heartbeat
from app.bridge.messages import time_message
from app.fixture import Reason, worst_first
from app.geometry import Stamp

_SEQ_MARK = 0x0123456789ABCDEF
_SEQ_MARK_BYTES = _SEQ_MARK.to_bytes(8, sys.byteorder)
_CDR_HEADER_BYTES = 4

_SHORT_SWITCH_INTERVAL_S = 0.0005


class _HoldIdentity(NamedTuple):
    """What identifies a hold to its receivers."""

    nonce: int
    since: Time


RandomBits = Callable[[int], int]
"""Returns a random integer of that many bits, as `secrets.randbits` does."""


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
        raw = serialize_message(message)
        # CDR: stamp (2 x 4 bytes), string length (4), string with its zero, seq aligned to 8.
        text_bytes = len(message.header.frame_id.encode()) + 1
        offset = _CDR_HEADER_BYTES + -(-(12 + text_bytes) // 8) * 8
        if raw[offset : offset + 8] != _SEQ_MARK_BYTES:
            raise BridgeError(f"serialised FixtureConstraint: expected seq at byte {offset}")
        return cls(raw[:offset], raw[offset + 8 :])

    def numbered(self, seq: int) -> bytes:
        """Bytes of the message with this ``seq``."""
        return self.before + seq.to_bytes(8, sys.byteorder) + self.after


class ConstraintStream:
    """Publishes each constraint at once and repeats it at ``hz`` from a heartbeat thread.

    Repetition does not extend the validity: ``valid_until`` and the stamp stay those of the
    samples. ``hz`` None repeats nothing. A message that is sent with ``valid_ns`` is replaced by a
    ``stale`` one on hold after that time, in case the stepping thread is stuck while the heartbeat
    continues. This counts as a fault, which the next message does not clear (see `publish`).
    Without ``valid_ns`` only the receiver checks the validity, with ``valid_until``.

    The stream sets ``instance_id``, which is constant, ``hold_since`` by ``clock_ns`` (system
    time), and ``rearm_nonce``: 0 unless the hold has to be re-armed, otherwise a random number that
    is replaced with each fault and each further cause of the hold, and ends with `spend`.
    ``random_bits`` creates both. A hold that begins with a stale message keeps its nonce and its
    begin in the messages that follow.

    Above 100 Hz the interpreter's switch interval is 0.5 ms until `close`
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
        self._random_bits = random_bits
        self._clock_ns = clock_ns
        self._hold_since: Time | None = None
        self.instance_id = f"{random_bits(64):016x}"
        self._nonce = 0
        self._next_nonce = self._draw()
        self._replacement: _HoldIdentity | None = None
        self._last: FixtureConstraint | None = None
        self._faulty = False
        self._fault_seq = 0
        self._switch_s = sys.getswitchinterval()
        if hz is not None and hz > 100.0:
            sys.setswitchinterval(min(self._switch_s, _SHORT_SWITCH_INTERVAL_S))
        self._heartbeat = Heartbeat(self._send, hz)

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
        begins = (faulty and not self._faulty) or self._has_new_cause(message)
        if begins and not self._heartbeat.ended:
            self._renew_nonce()
        self._identify(message)
        first = self._begin(message, valid_ns, since_ns, unless_ended=True)
        in_time = first is not None
        if not in_time:
            message.hold = True
            reasons = {*map(Reason, message.reasons), Reason.LATCHED}
            message.reasons = [str(reason) for reason in worst_first(reasons)]
            self._continue_hold()
            new_cause = self._has_new_cause(message)
            if new_cause:  # the operator has not seen it with the stale message
                self._renew_nonce()
            self._identify(message)
            first = self._begin(message, valid_ns, since_ns)
            begins = new_cause
        if first is not None and begins:
            self._fault_seq = first
        self._faulty = faulty
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
            self._renew_nonce()  # the next one has been published with the stale message
        self._renew_nonce()
        self._identify(message)
        first = self._begin(message, None)
        self._fault_seq = self._fault_seq if first is None else first
        self._faulty, self._last = True, message
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
                self._hold_since = self._replacement.since  # the stale message has begun the hold
            self._replacement = self._next_identity()
            last = self._raw_held(self._last, reason, self._replacement)
        self._last = None
        self._heartbeat.pause(last)

    def close(self) -> None:
        """End the thread; nothing is sent afterwards."""
        try:
            self._heartbeat.close()
        finally:
            sys.setswitchinterval(self._switch_s)

    @property
    def rearm_nonce(self) -> int:
        """Nonce of the hold that is latched; 0 if none is. Meaningless while `ended`."""
        return self._nonce

    def spend(self, nonce: int) -> None:
        """End the validity of ``nonce`` after it has re-armed its hold."""
        if self._nonce == nonce:
            self._nonce = 0

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
        stale = None if valid_ns is None else self._next_identity(valid_ns)
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

    def _has_new_cause(self, message: FixtureConstraint) -> bool:
        """True if a hold has got a cause that the previous message did not have."""
        known = () if self._last is None else self._last.hold_causes
        return bool(message.hold and not set(message.hold_causes) <= set(known))

    def _draw(self) -> int:
        """A random number other than 0."""
        while not (drawn := self._random_bits(64)):
            pass
        return drawn

    def _renew_nonce(self) -> None:
        self._nonce, self._next_nonce = self._next_nonce, self._draw()

    def _continue_hold(self) -> None:
        """Use the nonce and the begin of the hold that the replacement has already published."""
        if self._replacement is None:
            self._renew_nonce()
            return
        self._nonce, self._hold_since = self._replacement
        if self._next_nonce == self._nonce:
            self._next_nonce = self._draw()

    def _identify(self, message: FixtureConstraint) -> None:
        """Set the instance and the nonce of ``message``."""
        message.instance_id = self.instance_id
        self._hold_since = self._since(0) if message.hold else None
        message.hold_since = self._hold_since or Time()
        if Reason.LATCHED not in message.reasons:
            self._nonce = 0
        elif self._nonce == 0:
            self._renew_nonce()
        message.rearm_nonce = self._nonce

    def _since(self, delay_ns: int) -> Time:
        """Time at which the present hold began, or at which one begins after ``delay_ns``."""
        return self._hold_since or time_message(Stamp(self._clock_ns() + delay_ns))

    def _next_identity(self, delay_ns: int = 0) -> _HoldIdentity:
        """Of a hold that a new fault begins after ``delay_ns``, if none has begun before."""
        return _HoldIdentity(self._next_nonce, self._since(delay_ns))

    def _raw_held(
        self, message: FixtureConstraint, reason: str, identity: _HoldIdentity
    ) -> RawConstraint:
        """``message`` on hold by a new fault."""
        held = _held(message, reason)
        held.instance_id = self.instance_id
        held.rearm_nonce, held.hold_since = identity
        return RawConstraint.of(held)

    def _send(self, raw: RawConstraint, seq: int) -> None:
        self._publisher.publish(raw.numbered(seq))


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
    )
