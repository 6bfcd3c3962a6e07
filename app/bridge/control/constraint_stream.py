"""``~/constraint`` at the control rate: made into bytes once, repeated with a new ``seq`` alone."""

import math
import sys
from typing import NamedTuple, Protocol

from marginguard_msgs.msg import FixtureConstraint, HalfSpace
from rclpy.serialization import serialize_message

from app.bridge.errors import BridgeError
from app.bridge.heartbeat import Heartbeat
from app.fixture import Reason, worst_first

_MARK = 0x0123456789ABCDEF
_MARK_BYTES = _MARK.to_bytes(8, sys.byteorder)
_ENCAPSULATION = 4

_QUICK_SWITCH_S = 0.0005


class RawPublisher(Protocol):
    """What is asked of a publisher: rclpy's takes serialised messages as bytes."""

    def publish(self, raw: bytes) -> None:
        """Send the bytes of a message as they are."""


class RawConstraint(NamedTuple):
    """A serialised constraint without its ``seq``: what stands before and what stands after."""

    before: bytes
    after: bytes

    @classmethod
    def of(cls, message: FixtureConstraint) -> "RawConstraint":
        """Serialise ``message``, whose ``seq`` is changed by this."""
        message.seq = _MARK
        raw = serialize_message(message)
        # CDR: two numbers of 4 bytes (the stamp), a text with its length and a zero, seq at 8.
        text = len(message.header.frame_id.encode()) + 1
        place = _ENCAPSULATION + -(-(12 + text) // 8) * 8
        if raw[place : place + 8] != _MARK_BYTES:
            raise BridgeError(f"a serialised FixtureConstraint does not hold its seq at {place}")
        return cls(raw[:place], raw[place + 8 :])

    def numbered(self, seq: int) -> bytes:
        """The whole message with this ``seq``."""
        return self.before + seq.to_bytes(8, sys.byteorder) + self.after


class ConstraintStream:
    """Sends each constraint at once, and repeats it ``hz`` times a second from a thread.

    Repetition extends nothing: ``valid_until`` and the stamp stay those of the samples that went
    in. ``hz`` None repeats nothing. Up to a `newest` that says how long its message lasts, the
    receiver alone judges that by ``valid_until``; afterwards the message itself says ``stale``
    and holds, should the thread that takes the steps be stuck while this one still beats. That is
    a fault as any other: the next message does not undo it (`newest`).

    A stream of more than 100 Hz lets threads of this process take turns every half a millisecond
    (`sys.setswitchinterval`, for all of them, until `close`): with Python's own 5 ms a busy thread
    would make it miss beats.
    """

    def __init__(self, publisher: RawPublisher, hz: float | None) -> None:
        self._publisher = publisher
        self._last: FixtureConstraint | None = None
        self._faulty = False
        self._fault_seq = 0
        self._switch_s = sys.getswitchinterval()
        if hz is not None and hz > 100.0:
            sys.setswitchinterval(min(self._switch_s, _QUICK_SWITCH_S))
        self._heartbeat = Heartbeat(self._send, hz)

    def newest(self, message: FixtureConstraint, *, lasts_ns: int | None = None) -> bool:
        """Send ``message`` now and repeat it; after ``lasts_ns`` repeat it as stale and on hold.

        ``lasts_ns`` is how far ``valid_until`` is from now, at least 0, on whatever clock the
        caller has its stamps; None for a clock that can be stopped, as that of a replay.

        False when the one before had become stale, or was followed by a `rest`: then ``message``
        is sent on hold, as ``latched``, and the caller has to latch the hold where it decides.
        """
        first = self._begin(message, lasts_ns, unless_ended=True)
        in_time = first is not None
        if not in_time:
            message.hold = True
            reasons = {*map(Reason, message.reasons), Reason.LATCHED}
            message.reasons = [str(reason) for reason in worst_first(reasons)]
            first = self._begin(message, lasts_ns)
        faulty = message.state == FixtureConstraint.UNKNOWN
        if first is not None and in_time and faulty and not self._faulty:
            self._fault_seq = first
        self._faulty = faulty
        self._last = message
        return in_time

    def forget(self, message: FixtureConstraint) -> bool:
        """Repeat ``message``, which is UNKNOWN, in place of planes that mean nothing any more.

        It is a fault of its own, whatever was said before: nobody who looked at an earlier
        constraint can have looked at what comes after it. False, and nothing is sent, while
        nothing is repeated. Not to be called while another thread is at `rest`.
        """
        if self._last is None:
            return False
        first = self._begin(message, None)
        self._fault_seq = self._fault_seq if first is None else first
        self._faulty, self._last = True, message
        return True

    def rest(self, reason: str) -> None:
        """Hold for this reason as the last word, then silence until the next `newest`."""
        last = None if self._last is None else RawConstraint.of(_held(self._last, reason))
        self._last = None
        self._heartbeat.rest(last)

    def close(self) -> None:
        """End the thread; nothing is sent afterwards."""
        try:
            self._heartbeat.close()
        finally:
            sys.setswitchinterval(self._switch_s)

    @property
    def seq(self) -> int:
        """The number that the next message will have: so many were sent."""
        return self._heartbeat.seq

    @property
    def missed(self) -> int:
        """Beats that were left out because they came too late."""
        return self._heartbeat.missed

    @property
    def fault_seq(self) -> int:
        """The number of the first message that told of the latest fault; 0 before any."""
        return max(self._fault_seq, self._heartbeat.ended_seq)

    @property
    def ended(self) -> bool:
        """Whether what is repeated now is stale, or at rest."""
        return self._heartbeat.ended

    def _begin(
        self, message: FixtureConstraint, lasts_ns: int | None, *, unless_ended: bool = False
    ) -> int | None:
        return self._heartbeat.newest(
            RawConstraint.of(message),
            lasts_ns=lasts_ns,
            afterwards=None if lasts_ns is None else RawConstraint.of(_held(message, "stale")),
            unless_ended=unless_ended,
        )

    def _send(self, raw: RawConstraint, seq: int) -> None:
        self._publisher.publish(raw.numbered(seq))


def _held(message: FixtureConstraint, reason: str) -> FixtureConstraint:
    """The same planes on hold, of a tumour taken to be still; no number that is of now."""
    return FixtureConstraint(
        header=message.header,
        valid_until=message.valid_until,
        state=FixtureConstraint.UNKNOWN,
        reasons=[reason, *(known for known in message.reasons if known == "latched")],
        hold=True,
        half_spaces=[
            HalfSpace(normal=plane.normal, offset=plane.offset, point_on_tool=plane.point_on_tool)
            for plane in message.half_spaces
        ],
        signed_distance=math.nan,
        lower_bound=math.nan,
        stop_distance=math.nan,
        warn_distance=math.nan,
        sigma_tre=math.nan,
        model_id=message.model_id,
        registration_id=message.registration_id,
    )
