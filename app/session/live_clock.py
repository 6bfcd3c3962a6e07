"""The present on the clock of a live source: known, or estimated from the samples that arrive."""

import math

from app.geometry import Stamp

DRIFT = 2e-4
"""No more than this do two crystals drift apart, in seconds a second (200 ppm)."""


class SourceClock:
    """Tells what time it is for a source whose clock reads something else than the host's.

    A sample that arrives at ``host_ns`` with the stamp ``ns`` tells ``host_ns - ns``: the offset of
    the two clocks and the time that the sample was on its way. The least of these has been on its
    way for the shortest time and is taken for the offset; it may grow by `DRIFT` only, so that a
    way that becomes longer is seen as age and does not pass for an offset. What stays hidden is
    the shortest time that any sample took.

    With ``stamps_of_host`` the two clocks are one and nothing is estimated.
    """

    def __init__(self, *, stamps_of_host: bool) -> None:
        self._stamps_of_host = stamps_of_host
        self._offset_ns: int | None = 0 if stamps_of_host else None
        self._since_ns = 0

    def arrived(self, ns: int, host_ns: int) -> None:
        """Take in that a sample stamped ``ns`` was there at ``host_ns``."""
        if self._stamps_of_host:
            return
        seen_ns = host_ns - ns
        known_ns = self.offset_ns(host_ns)
        if known_ns is None or seen_ns < known_ns:
            self._offset_ns, self._since_ns = seen_ns, host_ns

    def restart(self) -> None:
        """Forget the estimate: the source has set its clock back or was started again."""
        if not self._stamps_of_host:
            self._offset_ns = None

    def offset_ns(self, host_ns: int) -> int | None:
        """Host time less source time, as far as it is known at ``host_ns``."""
        if self._offset_ns is None or self._stamps_of_host:
            return self._offset_ns
        return self._offset_ns + round(DRIFT * max(0, host_ns - self._since_ns))

    def now(self, host_ns: int) -> Stamp | None:
        """The present on the source's clock; None before the first sample."""
        offset_ns = self.offset_ns(host_ns)
        return None if offset_ns is None else Stamp(host_ns - offset_ns)

    def host_time_for(self, ns: int) -> int:
        """The host time after which the source's clock has gone on by ``ns`` at the least."""
        return ns if self._stamps_of_host else math.ceil(ns / (1.0 - DRIFT)) + 1
