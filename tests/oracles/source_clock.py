"""Oracle of the offset between host and source clock: an exhaustive search over all samples."""

from collections.abc import Iterator, Sequence

from app.session.live_frames import CONFIRMED_BY, CONFIRMED_WITHIN_NS, REMEMBERED_NS

DRIFT_PER = 5_000
"""1 ns of drift is allowed per so many ns of host time (200 ppm)."""


def exhaustive_offsets(arrivals: Sequence[tuple[int, int]]) -> Iterator[int | None]:
    """Offset in ns after each of the ``arrivals`` (stamp, host time), from all of those before.

    Independent of `SourceClock`: it keeps no state but the level and applies the rule of the class
    docstring to all remembered samples anew. Host times are small, so that the allowed drift is a
    whole number of ns.
    """
    level = None
    for count in range(1, len(arrivals) + 1):
        host_ns = arrivals[count - 1][1]
        waiting: dict[int, int] = {}
        for ns, at_ns in arrivals[:count]:
            if host_ns - at_ns <= REMEMBERED_NS:
                found = at_ns - ns - at_ns // DRIFT_PER
                waiting[ns] = min(found, waiting.get(ns, found))
        levels = sorted(waiting.values())
        while True:
            confirmed = [
                one
                for one in levels
                if sum(one <= other <= one + CONFIRMED_WITHIN_NS for other in levels)
                >= CONFIRMED_BY
                or (level is not None and one >= level - CONFIRMED_WITHIN_NS)
            ]
            if not confirmed or (level is not None and min(confirmed) >= level):
                break
            level = min(confirmed)
        yield None if level is None else level + host_ns // DRIFT_PER
