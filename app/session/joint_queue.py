"""Joints of a live source, until the present of the tracker reaches their stamps."""

from bisect import bisect_right, insort_right

from app.case import JointSample
from app.geometry import Stamp

MAX_JOINTS = 256
"""Most samples that wait; beyond it the oldest are dropped. 200 ms at 1 kHz are 200 samples."""


class JointQueue:
    """Holds joints that are ahead of the present, and returns the newest that is not.

    The joints of a robot are ahead where their clock's offset is positive or the tracker is slow.
    Joints that are ahead by more than ``ahead_ns`` are a fault of a clock: they are returned at
    once, for the session to find.
    """

    def __init__(self, ahead_ns: int) -> None:
        self._ahead_ns = ahead_ns
        self._waiting: list[JointSample] = []  # sorted by stamp
        self._returned: Stamp | None = None

    def add(self, sample: JointSample) -> bool:
        """Add ``sample``; False if it is older than the last one that `take` returned."""
        if self._returned is not None and sample.stamp < self._returned:
            return False
        insort_right(self._waiting, sample, key=_ns)
        del self._waiting[:-MAX_JOINTS]
        return True

    def take(self, now: Stamp) -> tuple[JointSample, ...]:
        """Remove the newest joints that are not ahead of ``now``, and all before them."""
        if not self._waiting:
            return ()
        newest = self._waiting[-1]
        if newest.stamp.ns > now.ns + self._ahead_ns:
            self.clear()
            return (newest,)
        count = bisect_right(self._waiting, now.ns, key=_ns)
        taken = self._waiting[:count]
        del self._waiting[:count]
        if taken:
            self._returned = taken[-1].stamp
        return tuple(taken[-1:])

    def clear(self) -> None:
        """Forget all joints."""
        self._waiting.clear()
        self._returned = None


def _ns(sample: JointSample) -> int:
    return sample.stamp.ns
