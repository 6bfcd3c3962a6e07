"""Which tumour and which registration a session on the ROS graph has, as its constraints say."""

from marginguard_msgs.msg import FixtureConstraint
from rclpy.serialization import deserialize_message

from app.case.live_recording import SessionChange


class SessionWatch:
    """Is shown a constraint now and then, and keeps what was replaced since the first in `changes`.

    Ten times a second is enough: a new tumour takes longer to be made ready. Constraints do not say
    whose they are. While several publishers speak, a tumour and a base that were there before are
    therefore taken for those of another session, and no change.
    """

    def __init__(self) -> None:
        self._shown: bytes | None = None
        self._ids: tuple[str, str] | None = None
        self._known: set[tuple[str, str]] = set()
        self._publishers = 0
        self.changes: list[SessionChange] = []

    def has_company(self, publishers: int) -> bool:
        """Take in how many publishers of constraints there are: whether one has come to another."""
        before, self._publishers = self._publishers, publishers
        return publishers > max(before, 1)

    def has_changed(self, received: tuple[int, bytes] | None) -> bool:
        """Whether this constraint, with the time at which it came, is of another tumour or base.

        None for no constraint yet. Bytes that are no constraint tell of no change.
        """
        if received is None or received[1] is self._shown:
            return False
        at_ns, self._shown = received
        try:
            message = deserialize_message(self._shown, FixtureConstraint)
        except Exception:  # whatever rclpy makes of a stranger's bytes, which are recorded as well
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
