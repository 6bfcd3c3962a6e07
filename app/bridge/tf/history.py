"""The samples of one edge of the tree, over the last seconds."""

from bisect import bisect_left, bisect_right

from app.bridge.tf.pose import Pose, between

_COMPACT = 1024
"""Samples that are out of date are taken off the front of a list in lots of this size."""

DISORDER_NS = 1_000_000_000
"""A sample this much older than the newest did not come late: its source has begun anew."""


class EdgeHistory:
    """Samples of ``parent_from_child`` in the order of their stamps, or one that always holds.

    Kept are those within ``keep_ns`` of the newest, ``most`` at most: memory is bounded however
    fast a source is. Samples may come out of order, but for a jump back by more than
    `DISORDER_NS`: what was known is forgotten then, and `restarts` counts it. Two samples of one
    stamp are a repetition: the first one stays, as in tf2, so that an answer does not change.
    """

    __slots__ = ("_first", "_keep_ns", "_most", "_poses", "_stamps", "parent", "restarts", "static")

    def __init__(self, parent: str, *, static: bool, keep_ns: int, most: int) -> None:
        self.parent = parent
        self.static = static
        self.restarts = 0
        self._keep_ns = keep_ns
        self._most = most
        self._stamps: list[int] = []
        self._poses: list[Pose] = []
        self._first = 0

    def insert(self, stamp_ns: int, pose: Pose) -> bool:
        """Take a sample in; False when its stamp was known or is too old to be kept."""
        if self.static:
            self._stamps, self._poses = [stamp_ns], [pose]
            return True
        stamps = self._stamps
        if not stamps or stamp_ns > stamps[-1]:
            stamps.append(stamp_ns)
            self._poses.append(pose)
            self._forget_old()
            return True
        if stamp_ns < stamps[-1] - DISORDER_NS:
            self._stamps, self._poses, self._first = [stamp_ns], [pose], 0
            self.restarts += 1
            return True
        place = bisect_left(stamps, stamp_ns, self._first)
        if stamps[place] == stamp_ns or stamp_ns < stamps[-1] - self._keep_ns:
            return False
        stamps.insert(place, stamp_ns)
        self._poses.insert(place, pose)
        self._forget_old()
        return True

    @property
    def newest_ns(self) -> int:
        """The stamp of the newest sample; a history is made together with its first one."""
        return self._stamps[-1]

    @property
    def oldest_ns(self) -> int:
        """The stamp of the oldest sample that is kept."""
        return self._stamps[self._first]

    def __len__(self) -> int:
        return len(self._stamps) - self._first

    def at(self, stamp_ns: int) -> Pose | None:
        """The pose at that time, between the samples around it; None beyond them."""
        if self.static:
            return self._poses[0]
        stamps = self._stamps
        if stamp_ns == stamps[-1]:
            return self._poses[-1]
        after = bisect_right(stamps, stamp_ns, self._first)
        if after == self._first or after == len(stamps):
            return None
        begin = stamps[after - 1]
        if begin == stamp_ns:
            return self._poses[after - 1]
        fraction = (stamp_ns - begin) / (stamps[after] - begin)
        return between(self._poses[after - 1], self._poses[after], fraction)

    def _forget_old(self) -> None:
        stamps = self._stamps
        until = stamps[-1] - self._keep_ns
        while stamps[self._first] < until or len(stamps) - self._first > self._most:
            self._first += 1
        if self._first >= _COMPACT:
            del stamps[: self._first], self._poses[: self._first]
            self._first = 0
