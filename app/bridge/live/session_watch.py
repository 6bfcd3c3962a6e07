"""Detect changes of the tumour and the registration of a session from its constraints."""

from marginguard_msgs.msg import FixtureConstraint
from rclpy.serialization import deserialize_message

from app.case.live_recording import SessionChange


class SessionWatch:
    """Samples the constraints of a session and lists changes since the first one in `changes`.

    Ten samples per second are sufficient, because a new tumour takes longer to prepare. Each run of
    a session is followed by its ``instance_id``: a run changes when its ids do, and a run that
    joins or replaces another one is a change if its ids differ from those before it.
    """

    def __init__(self) -> None:
        self._last_received: bytes | None = None
        self._ids: dict[str, tuple[str, str]] = {}
        self._last: tuple[str, str] | None = None
        self._publishers = 0
        self.changes: list[SessionChange] = []

    def has_new_publisher(self, publishers: int) -> bool:
        """Set the number of publishers of constraints; True if one has joined another."""
        before, self._publishers = self._publishers, publishers
        return publishers > max(before, 1)

    def has_changed(self, received: tuple[int, bytes] | None) -> bool:
        """True if a constraint, given with its time of receipt, has another tumour or registration.

        ``received`` is None before the first constraint. Invalid bytes are not a change.
        """
        if received is None or received[1] is self._last_received:
            return False
        at_ns, self._last_received = received
        try:
            message = deserialize_message(self._last_received, FixtureConstraint)
        except Exception:  # rclpy raises several unrelated types for invalid bytes
            return False
        ids = (message.model_id, message.registration_id)
        before = self._ids.get(message.instance_id, self._last)
        self._ids[message.instance_id] = self._last = ids
        if before is None or before == ids:
            return False
        parts = zip(("tumour", "registration"), before, ids, strict=True)
        replaced = ", ".join(name for name, known, now in parts if known != now)
        self.changes.append(SessionChange(at_ns, *ids, replaced))
        return True

    def note_replaced(self, at_ns: int, parts: str) -> None:
        """List a change that the session itself has reported at ``at_ns``."""
        self.changes.append(SessionChange(at_ns, *(self._last or ("", "")), parts))
