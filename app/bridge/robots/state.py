"""Poses of a robot's links, from tf or from joint states."""

from dataclasses import dataclass

from app.geometry import NS_PER_MS, FloatArray, Freshness, FreshnessLimits, freshness_of


@dataclass(frozen=True, slots=True, eq=False)
class RobotState:
    """``root_from_link`` of every link at one time.

    ``poses`` is (n, 4, 4) in mm, read-only, in the order of ``links``. It is None before the first
    poses, and holds the last ones while ``is_stale``. ``stamp_ns`` is that of the oldest sample
    used; None if all of them are static. ``problems`` lists descriptions of problems; not all of
    them make the poses stale.
    """

    root: str
    links: tuple[str, ...]
    poses: FloatArray | None
    stamp_ns: int | None
    is_stale: bool
    problems: tuple[str, ...] = ()


def age_problem(stamp_ns: int | None, now_ns: int, limits: FreshnessLimits) -> str:
    """The reason why a state with ``stamp_ns`` is not valid at ``now_ns``; empty if it is valid.

    A state without a stamp consists of static edges and is valid at any time.
    """
    if stamp_ns is None or freshness_of(stamp_ns, now_ns, limits) is Freshness.VALID:
        return ""
    age_ms = (now_ns - stamp_ns) / NS_PER_MS
    if age_ms < 0.0:
        allowed_ms = limits.future_tolerance_ns / NS_PER_MS
        return f"the state is {-age_ms:.0f} ms in the future; expected at most {allowed_ms:.0f} ms"
    allowed_ms = limits.stale_after_ns / NS_PER_MS
    return f"the state is {age_ms:.0f} ms old; expected at most {allowed_ms:.0f} ms"
