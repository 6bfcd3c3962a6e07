"""Memory of recent samples, to detect duplicates: these carry no information on the clock."""

from app.case import agreed_sample
from app.geometry import NS_PER_S, Edge, TrackedTransform

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
