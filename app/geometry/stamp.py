"""Stamps, recent values by stamp, and the freshness policy.

Every package calls `freshness_of` or `freshness_of_stamp`; none compares ages by itself. No clock
is read here.
"""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from enum import Enum
from typing import Any, Generic, TypeVar

from app.geometry.errors import InputError, StampError

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000

NEVER_NS = 10**18
"""A duration that no pose lasts: 31 years."""

_MAX_S = 4_600_000_000
"""Largest time in s, in the year 2115. The ns between any two times fit into 64 bits."""

_MAX_NS = _MAX_S * NS_PER_S


def slot_setters(value_type: type) -> tuple[Callable[[object, Any], None], ...]:
    """Return one setter per field of a frozen, slotted dataclass, in the order of its fields.

    A class method ``unchecked`` fills a new instance with them. A call takes half the time of
    `object.__setattr__`.
    """
    slots: tuple[str, ...] = vars(value_type)["__slots__"]
    return tuple(vars(value_type)[name].__set__ for name in slots)


def is_plain_number(text: str) -> bool:
    """True if ``text`` has ASCII characters only and no ``_``.

    Python would read ``1_0`` as ten and accepts digits of other scripts; other programs do not.
    """
    return text.isascii() and "_" not in text


@dataclass(frozen=True, slots=True)
class Stamp:
    """An acquisition time: ``ns`` nanoseconds on the clock named ``clock``.

    Comparing stamps of different clocks raises `StampError`: the offset between two clocks is a
    calibration result and not zero. So does a time beyond 4.6e9 s, before or after 0.
    """

    ns: int
    clock: str = "tracker"

    def __post_init__(self) -> None:
        if type(self.ns) is not int:
            raise StampError(f"stamp {self.ns!r} is a {type(self.ns).__name__}; expected int ns")
        if not self.clock:
            raise StampError("clock of a stamp is empty; expected the name of its clock")
        if not -_MAX_NS <= self.ns <= _MAX_NS:
            raise StampError(f"stamp {self.ns} ns is out of range; expected at most {_MAX_S:g} s")

    @classmethod
    def of_ns(cls, ns: int) -> "Stamp":
        """``ns`` on the tracker's clock, without the check of its type: for integers only."""
        made = object.__new__(cls)
        _set_ns(made, ns)
        _set_clock(made, "tracker")
        return made

    @classmethod
    def from_seconds(cls, seconds: str) -> "Stamp":
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
        return cls(int((number * NS_PER_S).to_integral_value()))

    def age_ns(self, now: "Stamp") -> int:
        """Time in ns from this stamp to ``now``; negative if this stamp is in the future."""
        if self.clock != now.clock:
            raise self._other_clock(now)
        return now.ns - self.ns

    def shifted(self, offset_ns: int, clock: str) -> "Stamp":
        """The same time on another clock, which reads ``offset_ns`` more."""
        return Stamp(self.ns + offset_ns, clock)

    def __lt__(self, other: "Stamp") -> bool:
        if self.clock != other.clock:
            raise self._other_clock(other)
        return self.ns < other.ns

    def __le__(self, other: "Stamp") -> bool:
        if self.clock != other.clock:
            raise self._other_clock(other)
        return self.ns <= other.ns

    def _other_clock(self, other: "Stamp") -> StampError:
        return StampError(
            f"stamps of the clocks {self.clock!r} and {other.clock!r} cannot be compared; "
            "expected one clock"
        )


_set_ns, _set_clock = slot_setters(Stamp)


_Value = TypeVar("_Value")

_COMPACT = 1024
"""Outdated values are removed from the front of the lists in batches of this size."""


class StampHistory(Generic[_Value]):
    """Values in the order of their stamps, whose order of arrival does not matter.

    Keeps values within ``keep_ns`` of the newest, at least ``min_values`` and at most
    ``max_values``. One that is older than the newest by more than ``restart_ns`` indicates a
    restarted source or a clock that was set back: it discards the others and is counted in
    `restarts`. Of two values with the same stamp ``merge(known, value)`` is kept.
    """

    def __init__(
        self,
        *,
        keep_ns: float,
        restart_ns: float,
        max_values: float,
        min_values: int = 1,
        merge: Callable[[_Value, _Value], _Value] = lambda known, value: known,
    ) -> None:
        self.restarts = 0
        self._keep_ns, self._restart_ns = keep_ns, restart_ns
        self._min_values, self._max_values = min_values, max_values
        self._merge = merge
        self._stamps: list[int] = []
        self._values: list[_Value] = []
        self._first = 0

    def insert(self, stamp_ns: int, value: _Value) -> bool:
        """Add a value; False if its stamp is known or too old."""
        stamps, values = self._stamps, self._values
        if not stamps or stamp_ns > stamps[-1]:
            stamps.append(stamp_ns)
            values.append(value)
            self._remove_old()
            return True
        if stamp_ns < stamps[-1] - self._restart_ns:
            self._stamps, self._values, self._first = [stamp_ns], [value], 0
            self.restarts += 1
            return True
        index = bisect_left(stamps, stamp_ns, self._first)
        if stamps[index] == stamp_ns:
            values[index] = self._merge(values[index], value)
            return False
        if stamp_ns < stamps[-1] - self._keep_ns:
            return False
        stamps.insert(index, stamp_ns)
        values.insert(index, value)
        self._remove_old()
        return True

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest value; a history has at least one."""
        return self._stamps[-1]

    @property
    def oldest_ns(self) -> int:
        """Stamp of the oldest value."""
        return self._stamps[self._first]

    def around(self, stamp_ns: int) -> tuple[_Value, _Value, float] | None:
        """The values before and after ``stamp_ns``, and its place between them from 0 to 1.

        Both are the value at ``stamp_ns`` if there is one. None outside the range of the stamps.
        """
        stamps, values = self._stamps, self._values
        after = bisect_left(stamps, stamp_ns, self._first)
        if after == len(stamps):
            return None
        if stamps[after] == stamp_ns:
            return values[after], values[after], 0.0
        if after == self._first:
            return None
        before_ns = stamps[after - 1]
        fraction = (stamp_ns - before_ns) / (stamps[after] - before_ns)
        return values[after - 1], values[after], fraction

    def _remove_old(self) -> None:
        stamps = self._stamps
        oldest_kept_ns = stamps[-1] - self._keep_ns
        while (count := len(stamps) - self._first) > self._min_values and (
            stamps[self._first] < oldest_kept_ns or count > self._max_values
        ):
            self._first += 1
        if self._first >= _COMPACT:
            del stamps[: self._first], self._values[: self._first]
            self._first = 0


class Freshness(Enum):
    """Verdict on one sample. Only ``VALID`` samples may be used or shown as current."""

    VALID = "valid"
    STALE = "stale"
    """Older than allowed."""
    FROZEN = "frozen"
    """Young enough, but its values have not changed for longer than a live sensor's can."""
    FUTURE = "future"
    """Stamped after the present: its clock cannot be trusted."""
    MISSING = "missing"
    """There is no sample."""


@dataclass(frozen=True, slots=True)
class FreshnessLimits:
    """Limits in ns, all inclusive: a sample at a limit is still valid.

    ``frozen_after_ns`` None: repeated values are allowed for any time. ``future_tolerance_ns``:
    how far a stamp may be ahead of the present, 0 unless the caller has a reason to allow more
    (the clocks of two hosts differ). ``numbers_ns``: the three limits, at most `NEVER_NS`, which
    stands for None. Raises `InputError` for a negative limit.
    """

    stale_after_ns: int
    frozen_after_ns: int | None = None
    future_tolerance_ns: int = 0
    numbers_ns: tuple[int, int, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("stale_after_ns", "frozen_after_ns", "future_tolerance_ns"):
            value = getattr(self, name)
            if value is not None and value < 0:
                raise InputError(f"{name} is {value}; expected 0 or more")
        frozen_ns = NEVER_NS if self.frozen_after_ns is None else self.frozen_after_ns
        given_ns = self.stale_after_ns, frozen_ns, self.future_tolerance_ns
        object.__setattr__(self, "numbers_ns", tuple(min(each, NEVER_NS) for each in given_ns))

    def is_frozen(self, unchanged_ns: int) -> bool:
        """True if values that have repeated for ``unchanged_ns`` count as frozen."""
        return self.frozen_after_ns is not None and unchanged_ns > self.frozen_after_ns


def freshness_of(
    stamp_ns: int | None, now_ns: int, limits: FreshnessLimits, unchanged_ns: int = 0
) -> Freshness:
    """Freshness at ``now_ns`` of a sample that was acquired at ``stamp_ns``, on the same clock.

    ``stamp_ns`` is None when there is no sample; ``unchanged_ns`` is the time for which its values
    have repeated. Of several faults the first of missing, future, stale and frozen is returned.
    """
    if stamp_ns is None:
        return Freshness.MISSING
    return VERDICTS[freshness_number(now_ns - stamp_ns, unchanged_ns, *limits.numbers_ns)]


VERDICTS = (Freshness.VALID, Freshness.STALE, Freshness.FROZEN, Freshness.FUTURE)
"""By the result of `freshness_number`."""


def freshness_number(
    age_ns: int,
    unchanged_ns: int,
    stale_after_ns: int,
    frozen_after_ns: int,
    future_tolerance_ns: int,
) -> int:
    """Number in `VERDICTS` of a sample of this age.

    The limits are those of `FreshnessLimits.numbers_ns`. Compiled code calls it, too.
    """
    if age_ns < -future_tolerance_ns:
        return 3
    if age_ns > stale_after_ns:
        return 1
    return 2 if unchanged_ns > frozen_after_ns else 0


def freshness_of_stamp(stamp: Stamp | None, now: Stamp, limits: FreshnessLimits) -> Freshness:
    """Return `freshness_of` two stamps; raises `StampError` for stamps of different clocks."""
    return freshness_of(None if stamp is None else -stamp.age_ns(now), 0, limits)


def stale_in_ns(stamp_ns: int, now_ns: int, limits: FreshnessLimits) -> int:
    """Time in ns from ``now_ns`` up to which the sample is not stale; negative once it is."""
    return limits.stale_after_ns - (now_ns - stamp_ns)
