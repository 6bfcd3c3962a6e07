"""A simulated world as values of the page."""

from typing import Any

from app.geometry import NS_PER_MS, NS_PER_S, Freshness, FreshnessLimits, freshness_of
from app.runtime import BodyKind, RequestOutcome, WorldMoment, WorldRequest, place_text

_COUNTED_S = 100


def is_current(moment: WorldMoment, now_ns: int, stale_after_ns: int) -> bool:
    """True if the poses of ``moment`` may be shown as those of ``now_ns``, of the same clock."""
    limits = FreshnessLimits(stale_after_ns)
    return freshness_of(moment.stamp_ns, now_ns, limits) is Freshness.VALID


def world_values(moment: WorldMoment, now_ns: int, stale_after_ns: int) -> dict[str, Any]:
    """The bodies with their age and place, the last request, and why there are none."""
    current = is_current(moment, now_ns, stale_after_ns)
    return {
        "count": _count(moment),
        "light": "valid" if current else "missing" if moment.stamp_ns is None else "stale",
        "age": _age(moment.stamp_ns, now_ns),
        "rows": [
            {
                "name": body.name,
                "kind": str(body.kind),
                "place": place_text(moment.poses[body.name])
                if body.name in moment.poses
                else "place not known",
                "at": _numbers(moment, body.name),
                "body": body.kind.is_body,
                "added": body.kind is BodyKind.ADDED,
            }
            for body in moment.bodies
        ],
        "problem": "" if moment.is_connected else "no simulation receives requests",
        "request": None if moment.request is None else _request(moment.request),
    }


def _numbers(moment: WorldMoment, name: str) -> list[float]:
    """Position in mm; empty while it is not known."""
    pose = moment.poses.get(name)
    return [] if pose is None else [round(float(each), 2) for each in pose.translation_mm]


def _count(moment: WorldMoment) -> str:
    count = sum(each.kind.is_body for each in moment.bodies)
    return f"{count} {'body' if count == 1 else 'bodies'}"


def _request(request: WorldRequest) -> dict[str, Any]:
    reason = f": {request.reason}" if request.reason else ""
    return {
        "line": f"{request.text}: {request.outcome}{reason}",
        "accepted": request.outcome in (RequestOutcome.DONE, RequestOutcome.WAITING),
        "outcome": str(request.outcome),
    }


def _age(stamp_ns: int | None, now_ns: int) -> str:
    if stamp_ns is None:
        return ""
    age_ns = max(now_ns - stamp_ns, 0)
    if age_ns >= _COUNTED_S * NS_PER_S:
        return f"over {_COUNTED_S} s"
    return f"{age_ns // NS_PER_MS} ms" if age_ns < NS_PER_S else f"{age_ns / NS_PER_S:.1f} s"
