"""Where a robot's links are, whether it was told by tf or by joint states."""

from dataclasses import dataclass

from app.geometry import FloatArray


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


def problem_of_age(stamp_ns: int | None, now_ns: int, stale_after_ns: int) -> str:
    """Why a state of that stamp cannot be used now; empty where it can."""
    if stamp_ns is None:
        return ""
    age_ns = now_ns - stamp_ns
    if age_ns > stale_after_ns:
        return f"the state is {age_ns / 1e6:.0f} ms old: {stale_after_ns / 1e6:.0f} ms allowed"
    if age_ns < -stale_after_ns:
        return f"the state is from {-age_ns / 1e6:.0f} ms in the future"
    return ""
