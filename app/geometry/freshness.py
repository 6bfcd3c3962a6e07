"""Freshness policy: decides from a stamp, the present and limits whether a sample may be used.

Every package calls this module; none compares ages by itself. No clock is read here.
"""

from dataclasses import dataclass
from enum import Enum

from app.geometry.errors import InputError
from app.geometry.stamp import Stamp


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
    (the clocks of two hosts differ). Raises `InputError` for a negative limit.
    """

    stale_after_ns: int
    frozen_after_ns: int | None = None
    future_tolerance_ns: int = 0

    def __post_init__(self) -> None:
        for name in ("stale_after_ns", "frozen_after_ns", "future_tolerance_ns"):
            value = getattr(self, name)
            if value is not None and value < 0:
                raise InputError(f"{name} is {value}; expected 0 or more")

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
    age_ns = now_ns - stamp_ns
    if age_ns < -limits.future_tolerance_ns:
        return Freshness.FUTURE
    if age_ns > limits.stale_after_ns:
        return Freshness.STALE
    if limits.is_frozen(unchanged_ns):
        return Freshness.FROZEN
    return Freshness.VALID


def freshness_of_stamp(stamp: Stamp | None, now: Stamp, limits: FreshnessLimits) -> Freshness:
    """Return `freshness_of` two stamps; raises `StampError` for stamps of different clocks."""
    return freshness_of(None if stamp is None else now.ns - stamp.age_ns(now), now.ns, limits)


def stale_in_ns(stamp_ns: int, now_ns: int, limits: FreshnessLimits) -> int:
    """Time in ns from ``now_ns`` up to which the sample is not stale; negative once it is."""
    return limits.stale_after_ns - (now_ns - stamp_ns)
