"""Where a robot's links are, whether it was told by tf or by joint states."""

from dataclasses import dataclass

from app.geometry import NS_PER_MS, FloatArray, Freshness, FreshnessLimits, freshness_of


@dataclass(frozen=True, slots=True, eq=False)
class RobotState:
    """``root_from_link`` of every link at one time.

    ``poses`` is (n, 4, 4) in mm, read-only, in the order of ``links``; None before they were
    known for the first time, the last known ones while ``is_stale``. ``stamp_ns`` is that of the
    oldest sample that they are made of; None for poses that hold always. ``problems`` says what
    is wrong, a sentence each; there can be some although the poses are not stale.
    """

    root: str
    links: tuple[str, ...]
    poses: FloatArray | None
    stamp_ns: int | None
    is_stale: bool
    problems: tuple[str, ...] = ()


def age_problem(stamp_ns: int | None, now_ns: int, limits: FreshnessLimits) -> str:
    """Why a state with that stamp cannot be used now; empty if it can.

    A state without a stamp consists of static edges alone and holds at any time.
    """
    if stamp_ns is None or freshness_of(stamp_ns, now_ns, limits) is Freshness.VALID:
        return ""
    age_ms = (now_ns - stamp_ns) / NS_PER_MS
    if age_ms < 0.0:
        allowed_ms = limits.future_tolerance_ns / NS_PER_MS
        return f"the state is {-age_ms:.0f} ms in the future; expected at most {allowed_ms:.0f} ms"
    allowed_ms = limits.stale_after_ns / NS_PER_MS
    return f"the state is {age_ms:.0f} ms old; expected at most {allowed_ms:.0f} ms"
