"""Present time on the clock of a live source, estimated from the samples that arrive."""

from app.geometry import NS_PER_MS, NS_PER_S, Stamp

_DRIFT_PER = 5_000
DRIFT = 1.0 / _DRIFT_PER
"""Largest drift between two crystal clocks, in seconds per second (200 ppm)."""

CONFIRMED_WITHIN_NS = 20 * NS_PER_MS
"""An offset that is lower than the estimate by less than this is accepted at once."""

CONFIRMED_BY = 3
"""Number of samples with different stamps that together replace any earlier estimate."""

REMEMBERED_NS = 10 * NS_PER_S
"""Time for which an unconfirmed sample waits for others that confirm it."""

MAX_UNCONFIRMED = 64
"""Most unconfirmed samples at once; beyond it the earliest arrival is dropped."""


class SourceClock:
    """Estimates the present on the clock of a source that differs from the host's.

    A sample that arrives at ``host_ns`` with the stamp ``ns`` gives ``host_ns - ns``: the offset of
    the two clocks plus the sample's latency. The smallest value has the lowest latency and is the
    estimate of the offset. The estimate may grow by `DRIFT` only, so that growing latency appears
    as age and not as an offset. The lowest latency itself cannot be observed.

    One wrong stamp far ahead would make all other samples look old until the drift has compensated
    it. An offset that is lower by more than `CONFIRMED_WITHIN_NS` is therefore accepted only when
    `CONFIRMED_BY` samples with different stamps agree on it within that bound and within
    `REMEMBERED_NS`; until then such a sample is from the future. The first offset needs the same
    confirmation, and no time is known before it. The present never goes back, except by `restart`.

    With ``stamps_of_host`` the two clocks are the same and nothing is estimated.
    """

    def __init__(self, *, stamps_of_host: bool) -> None:
        self._stamps_of_host = stamps_of_host
        # Offset minus the drift allowed since host time 0, so that offsets can be compared.
        self._level_ns: int | None = 0 if stamps_of_host else None
        self._unconfirmed: dict[int, tuple[int, int]] = {}
        """Level and time of arrival of each unconfirmed sample, by its stamp."""

    def observe(self, ns: int, host_ns: int) -> None:
        """Update the estimate with a sample stamped ``ns`` that arrived at ``host_ns``."""
        if self._stamps_of_host:
            return
        level_ns = host_ns - ns - host_ns // _DRIFT_PER
        if self._level_ns is not None and level_ns >= self._level_ns:
            return
        self._unconfirmed = {
            stamp_ns: (level, at_ns)
            for stamp_ns, (level, at_ns) in self._unconfirmed.items()
            if host_ns - at_ns <= REMEMBERED_NS
        }
        self._unconfirmed.setdefault(ns, (level_ns, host_ns))  # the first was the fastest
        if len(self._unconfirmed) > MAX_UNCONFIRMED:
            del self._unconfirmed[next(iter(self._unconfirmed))]
        while self._confirm():
            pass

    def restart(self) -> None:
        """Drop the estimate: the source has set its clock back or was restarted."""
        if not self._stamps_of_host:
            self._level_ns = None
            self._unconfirmed.clear()

    def offset_ns(self, host_ns: int) -> int | None:
        """Host time minus source time at ``host_ns``; None while it is not known."""
        if self._level_ns is None or self._stamps_of_host:
            return self._level_ns
        return self._level_ns + host_ns // _DRIFT_PER

    def now(self, host_ns: int) -> Stamp | None:
        """The present on the source's clock; None while it is not known."""
        offset_ns = self.offset_ns(host_ns)
        return None if offset_ns is None else Stamp(host_ns - offset_ns)

    def host_time_for(self, ns: int) -> int:
        """Host time in ns after which the source's clock has advanced by at least ``ns``."""
        return ns if self._stamps_of_host else -(-ns * _DRIFT_PER // (_DRIFT_PER - 1)) + 1

    def _confirm(self) -> bool:
        """Lower the level to the lowest confirmed one; return True if it changed."""
        levels = sorted(level_ns for level_ns, _ in self._unconfirmed.values())
        confirmed = [
            level_ns
            for level_ns, last_ns in zip(levels, levels[CONFIRMED_BY - 1 :], strict=False)
            if last_ns - level_ns <= CONFIRMED_WITHIN_NS
        ]
        if self._level_ns is not None:
            lowest_ns = self._level_ns - CONFIRMED_WITHIN_NS
            confirmed += [level_ns for level_ns in levels if level_ns >= lowest_ns]
        if not confirmed:
            return False
        confirmed_ns = self._level_ns = min(confirmed)
        self._unconfirmed = {
            ns: each for ns, each in self._unconfirmed.items() if each[0] < confirmed_ns
        }
        return True
