"""Detect changes of the tumour and the registration of a session from its constraints."""

from marginguard_msgs.msg import FixtureConstraint
from rclpy.serialization import deserialize_message

from app.case.live_recording import SessionChange


class SessionWatch:
    """Samples the constraints of a session and lists changes since the first one in `changes`.

    Ten samples per second are sufficient, because a new tumour takes longer to prepare. A
    constraint does not identify its session. While there are several publishers, ids that have
    occurred before are therefore attributed to another session and are not a change.
    """

    def __init__(self) -> None:
        self._last_received: bytes | None = None
        self._ids: tuple[str, str] | None = None
        self._known: set[tuple[str, str]] = set()
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
        if ids == self._ids or (self._publishers > 1 and ids in self._known):
            return False
        before, self._ids = self._ids, ids
        self._known.add(ids)
        if before is None:
            return False
        self.changes.append(SessionChange(at_ns, *ids))
        return True
