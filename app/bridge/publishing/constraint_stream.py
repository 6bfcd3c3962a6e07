"""Publish ``~/constraint`` at the control rate: serialise once, then change only ``seq``."""

import math
import sys
from typing import NamedTuple, Protocol

from marginguard_msgs.msg import FixtureConstraint, HalfSpace
from rclpy.serialization import serialize_message

from app.bridge.errors import BridgeError
from app.bridge.heartbeat import Heartbeat
from app.fixture import Reason, worst_first

_SEQ_MARK = 0x0123456789ABCDEF
_SEQ_MARK_BYTES = _SEQ_MARK.to_bytes(8, sys.byteorder)
_CDR_HEADER_BYTES = 4

_SHORT_SWITCH_INTERVAL_S = 0.0005


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

    Above 100 Hz the interpreter's switch interval is 0.5 ms until `close`
    (`sys.setswitchinterval`, for the whole process). With the default of 5 ms a busy thread would
    delay the heartbeat.
    """

    def __init__(self, publisher: RawPublisher, hz: float | None) -> None:
        self._publisher = publisher
        self._last: FixtureConstraint | None = None
        self._faulty = False
        self._fault_seq = 0
        self._switch_s = sys.getswitchinterval()
        if hz is not None and hz > 100.0:
            sys.setswitchinterval(min(self._switch_s, _SHORT_SWITCH_INTERVAL_S))
        self._heartbeat = Heartbeat(self._send, hz)

    def publish(self, message: FixtureConstraint, *, valid_ns: int | None = None) -> bool:
        """Publish ``message`` now and repeat it; after ``valid_ns`` repeat it as stale and on hold.

        ``valid_ns`` is the time from now to ``valid_until``, at least 0, on the clock of the
        caller's stamps. It is None for a clock that can stop, such as that of a replay.

        Returns False if the previous message had become stale or was followed by `hold`.
        ``message`` is then published on hold with the reason ``latched``, and the caller has to
        latch the hold in its own state.
        """
        first = self._begin(message, valid_ns, unless_ended=True)
        in_time = first is not None
        if not in_time:
            message.hold = True
            reasons = {*map(Reason, message.reasons), Reason.LATCHED}
            message.reasons = [str(reason) for reason in worst_first(reasons)]
            first = self._begin(message, valid_ns)
        faulty = message.state == FixtureConstraint.UNKNOWN
        if first is not None and in_time and faulty and not self._faulty:
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
        first = self._begin(message, None)
        self._fault_seq = self._fault_seq if first is None else first
        self._faulty, self._last = True, message
        return True

    def hold(self, reason: str) -> None:
        """Publish a last message on hold with ``reason``, then nothing until the next `publish`."""
        last = None if self._last is None else RawConstraint.of(_held(self._last, reason))
        self._last = None
        self._heartbeat.pause(last)

    def close(self) -> None:
        """End the thread; nothing is sent afterwards."""
        try:
            self._heartbeat.close()
        finally:
            sys.setswitchinterval(self._switch_s)

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
        self, message: FixtureConstraint, valid_ns: int | None, *, unless_ended: bool = False
    ) -> int | None:
        return self._heartbeat.update(
            RawConstraint.of(message),
            valid_ns=valid_ns,
            replacement=None if valid_ns is None else RawConstraint.of(_held(message, "stale")),
            unless_ended=unless_ended,
        )

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
