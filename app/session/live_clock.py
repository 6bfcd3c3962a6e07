"""The present on the clock of a live source: known, or estimated from the samples that arrive."""

from app.geometry import NS_PER_MS, NS_PER_S, Stamp

_DRIFT_PER = 5_000
DRIFT = 1.0 / _DRIFT_PER
"""No more than this do two crystals drift apart, in seconds a second (200 ppm)."""

CONFIRMED_WITHIN_NS = 20 * NS_PER_MS
"""A sample that is faster by less than this than what is known needs no other to be believed."""

CONFIRMED_BY = 3
"""So many samples, of as many stamps, are believed whatever was known before."""

REMEMBERED_NS = 10 * NS_PER_S
"""For how long a sample that is not believed waits for others like it."""

MOST_AHEAD = 64
"""So many wait at once; the first to come goes first."""


class SourceClock:
    """Tells what time it is for a source whose clock reads something else than the host's.

    A sample that arrives at ``host_ns`` with the stamp ``ns`` tells ``host_ns - ns``: the offset of
    the two clocks and the time that the sample was on its way. The least of these has been on its
    way for the shortest time and is taken for the offset; it may grow by `DRIFT` only, so that a
    way that becomes longer is seen as age and does not pass for an offset. What stays hidden is
    the shortest time that any sample took.

    One wrong stamp far ahead would so make all others look old for as long as the drift takes to
    make up for it. An offset that is less by more than `CONFIRMED_WITHIN_NS` is therefore believed
    when `CONFIRMED_BY` samples of different stamps say it, no further apart than that and within
    `REMEMBERED_NS`: up to then such a sample is from the future. So is the first offset of all, and
    no time is known before. The present never goes back, but by `restart`.

    With ``stamps_of_host`` the two clocks are one and nothing is estimated.
    """

    def __init__(self, *, stamps_of_host: bool) -> None:
        self._stamps_of_host = stamps_of_host
        # Offsets less the drift that is allowed since host time 0: these can be compared.
        self._level_ns: int | None = 0 if stamps_of_host else None
        self._ahead: dict[int, tuple[int, int]] = {}
        """Level and time of arrival of each sample that is not believed yet, by its stamp."""

    def arrived(self, ns: int, host_ns: int) -> None:
        """Take in that a sample stamped ``ns`` was there at ``host_ns``."""
        if self._stamps_of_host:
            return
        level_ns = host_ns - ns - host_ns // _DRIFT_PER
        if self._level_ns is not None and level_ns >= self._level_ns:
            return
        self._ahead = {
            stamp_ns: (level, at_ns)
            for stamp_ns, (level, at_ns) in self._ahead.items()
            if host_ns - at_ns <= REMEMBERED_NS
        }
        self._ahead.setdefault(ns, (level_ns, host_ns))  # the first of a stamp was the fastest
        if len(self._ahead) > MOST_AHEAD:
            del self._ahead[next(iter(self._ahead))]
        while self._believe():
            pass

    def restart(self) -> None:
        """Forget the estimate: the source has set its clock back or was started again."""
        if not self._stamps_of_host:
            self._level_ns = None
            self._ahead.clear()

    def offset_ns(self, host_ns: int) -> int | None:
        """Host time less source time, as far as it is known at ``host_ns``."""
        if self._level_ns is None or self._stamps_of_host:
            return self._level_ns
        return self._level_ns + host_ns // _DRIFT_PER

    def now(self, host_ns: int) -> Stamp | None:
        """The present on the source's clock; None while that is not known."""
        offset_ns = self.offset_ns(host_ns)
        return None if offset_ns is None else Stamp(host_ns - offset_ns)

    def host_time_for(self, ns: int) -> int:
        """The host time after which the source's clock has gone on by ``ns`` at the least."""
        return ns if self._stamps_of_host else -(-ns * _DRIFT_PER // (_DRIFT_PER - 1)) + 1

    def _believe(self) -> bool:
        """Lower the level to what is confirmed, by the level itself or by one another."""
        levels = sorted(level_ns for level_ns, _ in self._ahead.values())
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
        believed_ns = self._level_ns = min(confirmed)
        self._ahead = {ns: each for ns, each in self._ahead.items() if each[0] < believed_ns}
        return True
