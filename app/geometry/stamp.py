"""A moment on a named clock, in integer nanoseconds."""

from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

from app.geometry.errors import StampError
from app.geometry.plain_text import is_plain

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000

_MOST_S = 9_000_000_000
"""Seconds whose nanoseconds still fit into the 64 bits that ROS and MCAP give them."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """An acquisition time: ``ns`` nanoseconds on the clock that is called ``clock``.

    Stamps of different clocks are never compared: doing so raises `StampError`, because the
    offset between two clocks is a calibration result and not zero.
    """

    ns: int
    clock: str = "tracker"

    def __post_init__(self) -> None:
        if type(self.ns) is not int:
            raise StampError(f"stamp {self.ns!r} is a {type(self.ns).__name__}: int ns wanted")
        if not self.clock:
            raise StampError("a stamp needs the name of its clock, got an empty one")

    @classmethod
    def from_seconds(cls, seconds: str, clock: str = "tracker") -> "Stamp":
        """Read decimal seconds as they stand in a file, without a detour through binary floats."""
        try:
            number = Decimal(seconds.strip() if is_plain(seconds) else "")
        except InvalidOperation as error:
            raise StampError(f"time {seconds!r} is not a finite number of seconds") from error
        if not (number.is_finite() and -_MOST_S <= number <= _MOST_S):
            raise StampError(f"time {seconds!r} is not a finite number of seconds up to 9e9")
        return cls(int((number * NS_PER_S).to_integral_value()), clock)

    def age_ns(self, now: "Stamp") -> int:
        """How long before ``now`` this moment was; negative when it lies in the future."""
        self._check_clock(now)
        return now.ns - self.ns

    def shifted(self, offset_ns: int, clock: str) -> "Stamp":
        """The same moment on another clock that reads ``offset_ns`` more."""
        return Stamp(self.ns + offset_ns, clock)

    def __lt__(self, other: "Stamp") -> bool:
        self._check_clock(other)
        return self.ns < other.ns

    def __le__(self, other: "Stamp") -> bool:
        self._check_clock(other)
        return self.ns <= other.ns

    def _check_clock(self, other: "Stamp") -> None:
        if self.clock != other.clock:
            raise StampError(
                f"stamps of the clocks {self.clock!r} and {other.clock!r} cannot be compared"
            )
