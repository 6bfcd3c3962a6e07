"""A guided registration of the robot as values of the page."""

from typing import Any

from app.runtime import RegistrationStatus, registration_count, registration_verdict


def registration_values(status: RegistrationStatus, *, can_undo: bool) -> dict[str, Any]:
    """Phase, points with their errors, and verdict; ``can_undo``: the one before can return."""
    fit = status.fit
    verdict, advice = registration_verdict(status)
    points = () if fit is None else fit.points
    return {
        "revision": status.revision,
        "phase": status.phase.value,
        "count": registration_count(status),
        "points": [
            {
                "n": number,
                "id": str(each.interval[0]),  # JavaScript's numbers have 53 bits
                "residual": "" if each.residual_mm is None else f"{each.residual_mm:.2f}",
                "left_out": "" if each.leave_one_out_mm is None else f"{each.leave_one_out_mm:.2f}",
                "problem": each.problem,
            }
            for number, each in enumerate(points, start=1)
        ],
        "problem": status.problem,
        "verdict": verdict,
        "ok": fit is not None and fit.accepted,
        "advice": advice,
        "ready": status.can_accept,
        "restore": status.can_restore,
        "undo": can_undo,
    }
