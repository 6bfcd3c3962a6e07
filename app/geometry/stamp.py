"""Time on a named clock, in integer ns."""

from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

from app.geometry.errors import StampError
from app.geometry.plain_number import is_plain_number
from app.geometry.slots import slot_setters

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000

_MAX_S = 9_000_000_000
"""Largest time in s. Its ns fit into the 64 bits that ROS and MCAP use."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """An acquisition time: ``ns`` nanoseconds on the clock named ``clock``.

    Comparing stamps of different clocks raises `StampError`: the offset between two clocks is a
    calibration result and not zero.
    """

    ns: int
    clock: str = "tracker"

    def __post_init__(self) -> None:
        if type(self.ns) is not int:
            raise StampError(f"stamp {self.ns!r} is a {type(self.ns).__name__}; expected int ns")
        if not self.clock:
            raise StampError("clock of a stamp is empty; expected the name of its clock")

    @classmethod
    def of_ns(cls, ns: int) -> "Stamp":
        """``ns`` on the tracker's clock, without the check of its type: for integers only."""
        made = object.__new__(cls)
        _set_ns(made, ns)
        _set_clock(made, "tracker")
        return made

    @classmethod
    def from_seconds(cls, seconds: str, clock: str = "tracker") -> "Stamp":
        """Read decimal seconds from text exactly, without conversion to a binary float.

        Raises `StampError` for text that is not a number or out of range.
        """
        try:
            number = Decimal(seconds.strip() if is_plain_number(seconds) else "")
        except InvalidOperation as error:
            raise StampError(
                f"time {seconds!r} is not a finite number of seconds; expected a decimal number"
            ) from error
        if not (number.is_finite() and -_MAX_S <= number <= _MAX_S):
            raise StampError(
                f"time {seconds!r} is not a finite number of seconds within the range; "
                f"expected at most {_MAX_S:g} s in size"
            )
        return cls(int((number * NS_PER_S).to_integral_value()), clock)

    def age_ns(self, now: "Stamp") -> int:
        """Time in ns from this stamp to ``now``; negative if this stamp is in the future."""
        self._check_clock(now)
        return now.ns - self.ns

    def shifted(self, offset_ns: int, clock: str) -> "Stamp":
        """The same time on another clock, which reads ``offset_ns`` more."""
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
                f"stamps of the clocks {self.clock!r} and {other.clock!r} cannot be compared; "
                "expected one clock"
            )


_set_ns, _set_clock = slot_setters(Stamp)
