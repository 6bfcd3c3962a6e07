"""Recent samples of one edge of the transform tree."""

from bisect import bisect_left, bisect_right

from app.bridge.tf.pose import Pose, interpolate

_COMPACT = 1024
"""Outdated samples are removed from the front of the lists in batches of this size."""

DISORDER_NS = 1_000_000_000
"""A sample that is older than the newest by more than this indicates a restarted source."""


class EdgeHistory:
    """Samples of ``parent_from_child`` in the order of their stamps, or one static sample.

    Keeps samples within ``keep_ns`` of the newest, ``max_samples`` at most. Samples may arrive out
    of order. A jump back by more than `DISORDER_NS` discards the history and is counted in
    `restarts`. Of two samples with the same stamp the first is kept, as in tf2, so that the result
    of a lookup does not change.
    """

    __slots__ = (
        "_first",
        "_keep_ns",
        "_max_samples",
        "_poses",
        "_stamps",
        "parent",
        "restarts",
        "static",
    )

    def __init__(self, parent: str, *, static: bool, keep_ns: int, max_samples: int) -> None:
        self.parent = parent
        self.static = static
        self.restarts = 0
        self._keep_ns = keep_ns
        self._max_samples = max_samples
        self._stamps: list[int] = []
        self._poses: list[Pose] = []
        self._first = 0

    def insert(self, stamp_ns: int, pose: Pose) -> bool:
        """Add a sample; False if its stamp is known or too old."""
        if self.static:
            self._stamps, self._poses = [stamp_ns], [pose]
            return True
        stamps = self._stamps
        if not stamps or stamp_ns > stamps[-1]:
            stamps.append(stamp_ns)
            self._poses.append(pose)
            self._remove_old()
            return True
        if stamp_ns < stamps[-1] - DISORDER_NS:
            self._stamps, self._poses, self._first = [stamp_ns], [pose], 0
            self.restarts += 1
            return True
        index = bisect_left(stamps, stamp_ns, self._first)
        if stamps[index] == stamp_ns or stamp_ns < stamps[-1] - self._keep_ns:
            return False
        stamps.insert(index, stamp_ns)
        self._poses.insert(index, pose)
        self._remove_old()
        return True

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest sample; a history has at least one."""
        return self._stamps[-1]

    @property
    def oldest_ns(self) -> int:
        """Stamp of the oldest sample."""
        return self._stamps[self._first]

    def __len__(self) -> int:
        return len(self._stamps) - self._first

    def at(self, stamp_ns: int) -> Pose | None:
        """Pose interpolated at ``stamp_ns``; None outside the range of the samples."""
        if self.static:
            return self._poses[0]
        stamps = self._stamps
        if stamp_ns == stamps[-1]:
            return self._poses[-1]
        after = bisect_right(stamps, stamp_ns, self._first)
        if after == self._first or after == len(stamps):
            return None
        before_ns = stamps[after - 1]
        if before_ns == stamp_ns:
            return self._poses[after - 1]
        fraction = (stamp_ns - before_ns) / (stamps[after] - before_ns)
        return interpolate(self._poses[after - 1], self._poses[after], fraction)

    def _remove_old(self) -> None:
        stamps = self._stamps
        oldest_kept_ns = stamps[-1] - self._keep_ns
        while stamps[self._first] < oldest_kept_ns or len(stamps) - self._first > self._max_samples:
            self._first += 1
        if self._first >= _COMPACT:
            del stamps[: self._first], self._poses[: self._first]
            self._first = 0
