"""Samples that were there a moment ago: what comes again tells nothing of its source's clock."""

from app.case import agreed_sample
from app.geometry import NS_PER_S, TrackedTransform
from app.session.pose_tree import Edge

REMEMBERED_NS = 5 * NS_PER_S
"""For how long after its arrival a sample is remembered."""

MOST_REMEMBERED = 20_000
"""Of one edge; then those that came first are forgotten."""


class RecentSamples:
    """The samples of each edge that came last, by host time, to know those that come again.

    It grows with the rate of what it is given: nothing but the edges in use.
    """

    def __init__(self) -> None:
        self._edges: dict[Edge, dict[int, tuple[int, TrackedTransform]]] = {}

    def was_there(self, sample: TrackedTransform, host_ns: int) -> bool:
        """Take in a sample; True when the very same, to the digit, came before it."""
        remembered = self._edges.setdefault((sample.target, sample.source), {})
        while remembered and _first_ns(remembered) < host_ns - REMEMBERED_NS:
            del remembered[next(iter(remembered))]
        _, known = remembered.pop(sample.stamp.ns, (0, None))
        # What is repeated for ever is remembered for ever.
        remembered[sample.stamp.ns] = (host_ns, sample)
        if len(remembered) > MOST_REMEMBERED:
            del remembered[next(iter(remembered))]
        return known is not None and agreed_sample(known, sample) is known


def _first_ns(remembered: dict[int, tuple[int, TrackedTransform]]) -> int:
    arrived_ns, _ = next(iter(remembered.values()))
    return arrived_ns
