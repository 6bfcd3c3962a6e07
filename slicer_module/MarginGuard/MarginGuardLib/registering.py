"""Where a new registration of the robot's base comes from, and how the panel tells of it."""

from pathlib import Path

from app.case import open_case
from app.geometry import FloatArray, InputError
from app.registration import RegistrationResult, register_points
from app.session import REFERENCE, robot_from_case, with_estimated_clock, with_repaired_tumor


def registration_of_case(folder: Path) -> RegistrationResult:
    """What ``marginguard register`` finds in the case; takes seconds."""
    case, _ = with_estimated_clock(with_repaired_tumor(open_case(folder)))
    robot = robot_from_case(case)
    if robot is None or robot.registration is None:
        raise InputError(f"{folder} has no robot: there is nothing to register")
    return robot.registration


def registration_of_landmarks(
    in_reference_mm: FloatArray, in_base_mm: FloatArray, base_frame: str
) -> RegistrationResult:
    """What the service ``~/register`` finds for these points (n, 3), in the same order."""
    return register_points(
        in_reference_mm, in_base_mm, fixed_frame=REFERENCE, moving_frame=base_frame
    )


def registration_text(result: RegistrationResult) -> str:
    """One line: the method, its residual, and the verdict with its reason."""
    fre = "" if result.fre_mm is None else f", FRE {result.fre_mm:.2f} mm"
    points = f", {len(result.used)} points" if len(result.residuals_mm) else ""
    verdict = "accepted" if result.accepted else "refused"
    return f"{result.method.replace('_', ' ')}{points}{fre}: {verdict}, {result.reason}"
