"""New registrations of the robot's base, from a case or landmarks, and their text."""

from pathlib import Path

from app.geometry import FloatArray
from app.registration import RegistrationResult, register_points
from app.runtime import register_case
from app.session import REFERENCE


def registration_of_case(folder: Path) -> RegistrationResult:
    """Register the case as ``marginguard register`` does; takes seconds. Raises `InputError`."""
    return register_case(folder).registration


def registration_of_landmarks(
    in_reference_mm: FloatArray, in_base_mm: FloatArray, base_frame: str
) -> RegistrationResult:
    """Register corresponding points (n, 3) in mm as the service ``~/register`` does."""
    return register_points(
        in_reference_mm, in_base_mm, fixed_frame=REFERENCE, moving_frame=base_frame
    )


def registration_text(result: RegistrationResult) -> str:
    """Format method, residual and verdict with its reason in one line."""
    fre = "" if result.fre_mm is None else f", FRE {result.fre_mm:.2f} mm"
    points = f", {len(result.used)} points" if len(result.residuals_mm) else ""
    verdict = "accepted" if result.accepted else "refused"
    return f"{result.method.replace('_', ' ')}{points}{fre}: {verdict}, {result.reason}"
