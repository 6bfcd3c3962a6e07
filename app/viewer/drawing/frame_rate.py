"""How often to draw: what one picture costs decides."""

from app.geometry import NS_PER_S

_SHARE = 0.7
"""Of the time that drawing alone would take up; above it a backlog builds up."""
_FASTEST_HZ, _SLOWEST_HZ = 30.0, 2.0
_MEMORY = 0.8
"""How much of the last estimate is kept when a picture was cheaper; a dearer one counts at once."""


class Pace:
    """The pause between two pictures: their rate stays below 0.7 of what one of them allows."""

    def __init__(self) -> None:
        self._cost_ns = 0.0

    def drew(self, cost_ns: int) -> None:
        """Take in what the last picture cost, all that kept the thread busy."""
        self._cost_ns = max(float(cost_ns), _MEMORY * self._cost_ns + (1.0 - _MEMORY) * cost_ns)

    @property
    def period_ns(self) -> int:
        """From the begin of one picture to the begin of the next."""
        wanted = self._cost_ns / _SHARE
        return round(min(max(wanted, NS_PER_S / _FASTEST_HZ), NS_PER_S / _SLOWEST_HZ))
