"""Detect a second sender by sequence numbers, where the middleware identifies no sender."""

from collections import OrderedDict, deque
from collections.abc import Hashable

from app.geometry import NS_PER_S

DROPS_WITHIN_NS = 5 * NS_PER_S
"""Two drops of the sequence number within this time mean two senders."""

ENDED_NS = 20 * NS_PER_S
"""Time without a drop after which a second sender has ended."""


MAX_SAMPLES = 256
"""Samples that are remembered to recognise copies."""


class SequenceTrail:
    """Counts the drops of the sequence numbers of one stream.

    Each sender numbers its messages upwards, and the middleware delivers those of one sender in
    order. A restarted sender begins anew: one drop. Two senders drop at each change from the one
    with the higher number to the other one. A copy of a remembered sample is not counted. Times
    are of a monotonic clock in ns.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._drops_ns: deque[int] = deque(maxlen=2)
        self._conflict_ns: int | None = None
        self._recent: OrderedDict[Hashable, None] = OrderedDict()

    def observe(self, sequence: int, sample: Hashable, now_ns: int) -> None:
        """Process ``sample``, which arrived at ``now_ns`` in the message ``sequence``."""
        if sample in self._recent:
            return
        self._recent[sample] = None
        if len(self._recent) > MAX_SAMPLES:
            self._recent.popitem(last=False)
        if self._last is not None and sequence <= self._last:
            self._drops_ns.append(now_ns)
            if len(self._drops_ns) == 2 and now_ns - self._drops_ns[0] <= DROPS_WITHIN_NS:
                self._conflict_ns = now_ns
        self._last = sequence

    @property
    def conflict(self) -> bool:
        """True after a conflict, until `check` finds that it has ended."""
        return self._conflict_ns is not None

    def check(self, now_ns: int) -> bool:
        """True if there are two senders."""
        if self._conflict_ns is not None and now_ns - self._conflict_ns >= ENDED_NS:
            self._conflict_ns = None
            self._drops_ns.clear()
        return self._conflict_ns is not None
