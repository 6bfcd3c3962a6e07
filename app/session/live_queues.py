"""Samples of a live source that wait for their frame or are remembered as received."""

from bisect import bisect_right, insort_right
from collections.abc import Collection, Iterable

from app.case import JointSample, agreed_sample
from app.geometry import NS_PER_S, Edge, Stamp, TrackedTransform, shortest_path

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


REMEMBERED_NS = 5 * NS_PER_S
"""Time after its arrival for which a sample is remembered."""

MAX_REMEMBERED = 20_000
"""Samples per edge; beyond it the earliest arrivals are dropped."""


class RecentSamples:
    """The last samples of each edge by host time, to detect duplicates.

    Its size grows with the sample rate; feed it the edges in use only.
    """

    def __init__(self) -> None:
        self._edges: dict[Edge, dict[int, tuple[int, TrackedTransform]]] = {}

    def is_duplicate(self, sample: TrackedTransform, host_ns: int) -> bool:
        """Store a sample; True if an identical one with the same stamp is remembered."""
        remembered = self._edges.setdefault((sample.target, sample.source), {})
        while remembered and _first_ns(remembered) < host_ns - REMEMBERED_NS:
            del remembered[next(iter(remembered))]
        _, known = remembered.pop(sample.stamp.ns, (0, None))
        # Inserted anew: a sample that keeps being repeated never expires.
        remembered[sample.stamp.ns] = (host_ns, sample)
        if len(remembered) > MAX_REMEMBERED:
            del remembered[next(iter(remembered))]
        return known is not None and agreed_sample(known, sample) is known


def _first_ns(remembered: dict[int, tuple[int, TrackedTransform]]) -> int:
    arrived_ns, _ = next(iter(remembered.values()))
    return arrived_ns


class AuxiliarySamples:
    """Newest sample of each edge that leads to one of ``frames``, and to no frame of a decision.

    They neither begin nor delay a frame of the session, and do not train its clock. A stamp that is
    older than the one before is dropped, unless that one is after the present.
    """

    def __init__(self, frames: Collection[str]) -> None:
        self._frames = frozenset(frames)
        self._edges: frozenset[Edge] = frozenset()
        self._newest_ns: dict[Edge, int] = {}
        self._waiting: dict[Edge, TrackedTransform] = {}

    def find(self, edges: Iterable[Edge], used: frozenset[Edge], root: str) -> None:
        """Choose those of ``edges`` that connect ``root`` with the frames, and are not ``used``."""
        known = tuple(edges)
        paths = [shortest_path(known, root, frame) or () for frame in sorted(self._frames)]
        self._edges = frozenset(edge for path in paths for edge in path) - used

    def add(self, sample: TrackedTransform, now: Stamp | None) -> None:
        """Keep ``sample`` for the next frame if its edge is one of those chosen."""
        edge = (sample.target, sample.source)
        if edge not in self._edges:
            return
        newest_ns = self._newest_ns.get(edge)
        is_ahead = newest_ns is not None and now is not None and newest_ns > now.ns
        if newest_ns is None or is_ahead or sample.stamp.ns > newest_ns:
            self._newest_ns[edge] = sample.stamp.ns
            self._waiting[edge] = sample

    def take(self) -> tuple[TrackedTransform, ...]:
        """Remove the samples that came since the last call."""
        samples = tuple(self._waiting.values())
        self._waiting.clear()
        return samples

    def restart(self) -> None:
        """Forget the samples: the source's clock was set back."""
        self._newest_ns.clear()
        self._waiting.clear()
