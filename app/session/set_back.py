"""A source that sets its clock back by less than a jump, told from a way that becomes longer."""

from app.case import agreed_sample
from app.geometry import NS_PER_MS, NS_PER_S, TrackedTransform
from app.session.pose_tree import Edge

STEADY_NS = 5 * NS_PER_S
"""For how long every sample must say the same."""

SPREAD_NS = 20 * NS_PER_MS
"""A sample that is faster by more than this does not say the same."""

BACK_NS = 100 * NS_PER_MS
"""So much before an earlier one a stamp has to be: those of one clock jitter by less."""

REMEMBERED_NS = 5 * NS_PER_S
"""Samples that are older than the newest of their edge by more than this are forgotten."""

MOST_REMEMBERED = 20_000
"""Of one edge; then those that came first are forgotten."""


class SetBack:
    """Sees from the samples of all edges that the clock which stamped them was set back.

    Once it has happened, the stamps look as they do after their way has become longer: all of them
    are older by as much. How it began tells the two apart. A way that keeps the order of what is
    sent (a DDS writer's, a TCP stream) never brings a sample that is older than one before, however
    long it becomes, and what is brought twice was there already. New samples that are stamped
    before the newest one are therefore those of a clock that was set back, if the way keeps the
    order. It does not where one of those is followed by a sample that is as fast as ever: then two
    ways lead here, of which the slow one may be left, and nothing is believed until `restart`.

    Believed is what is stale by the clock as it was, and what every sample said for `STEADY_NS`.
    """

    def __init__(self, stale_after_ns: int) -> None:
        self._stale_after_ns = stale_after_ns
        self.restart()

    def restart(self) -> None:
        """Forget everything: the clock is estimated anew."""
        self._edges: dict[Edge, _Remembered] = {}
        self._keeps_order = True
        self._since_ns: int | None = None
        self._delay_ns = 0

    def knows(self, sample: TrackedTransform) -> bool:
        """Whether this very sample was there already, not long ago."""
        remembered = self._edges.get((sample.target, sample.source))
        return remembered is not None and remembered.knows(sample)

    def saw(self, sample: TrackedTransform, host_ns: int, delay_ns: int) -> bool:
        """Take in a sample that is there; True when it is certain that the clock was set back.

        ``delay_ns``: how much later than the fastest it is there, by the clock as it was.
        """
        edge = (sample.target, sample.source)
        remembered = self._edges.setdefault(edge, _Remembered(sample.stamp.ns))
        is_new_and_late = remembered.is_new_and_late(sample)
        remembered.add(sample, is_of_the_future=delay_ns < -SPREAD_NS)
        if delay_ns <= self._stale_after_ns:
            self._keeps_order &= self._since_ns is None
            self._since_ns = None
            return False
        if self._since_ns is not None and delay_ns >= self._delay_ns - SPREAD_NS:
            return host_ns - self._since_ns >= STEADY_NS
        begins = is_new_and_late and self._keeps_order
        self._since_ns, self._delay_ns = (host_ns if begins else None), delay_ns
        return False


class _Remembered:
    """The samples of one edge by their stamps, in the order in which they came."""

    def __init__(self, first_ns: int) -> None:
        self._samples: dict[int, TrackedTransform] = {}
        self._newest_ns = self._forgotten_ns = first_ns

    def knows(self, sample: TrackedTransform) -> bool:
        known = self._samples.get(sample.stamp.ns)
        return known is not None and agreed_sample(known, sample) is known

    def is_new_and_late(self, sample: TrackedTransform) -> bool:
        """Before what is remembered nobody knows whether it is new.

        A lost pose is no evidence: trackers stamp it with what they please.
        """
        is_late = self._forgotten_ns < sample.stamp.ns < self._newest_ns - BACK_NS
        return is_late and sample.transform is not None and not self.knows(sample)

    def add(self, sample: TrackedTransform, *, is_of_the_future: bool) -> None:
        """One of the future makes no other late."""
        self._samples[sample.stamp.ns] = sample
        if not is_of_the_future:
            self._newest_ns = max(self._newest_ns, sample.stamp.ns)
        while (first_ns := next(iter(self._samples))) < self._newest_ns - REMEMBERED_NS or len(
            self._samples
        ) > MOST_REMEMBERED:
            self._forgotten_ns = max(self._forgotten_ns, first_ns)
            del self._samples[first_ns]
