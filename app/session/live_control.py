"""Parameters of the twist limiter, the guidance force and the tumour's motion in ``live.yaml``."""

from app.case import LiveCase
from app.fixture import GuidanceParameters, LimiterParameters, TumorMotionParameters
from app.geometry import InputError, MarginGuardError


def guidance_parameters(live: LiveCase) -> GuidanceParameters | None:
    """Parameters of ``guidance``, None without it; raises `InputError` if not passive."""
    if live.guidance is None:
        return None
    try:
        return GuidanceParameters(**live.guidance)
    except MarginGuardError as error:
        raise InputError(f"{live.case.manifest.file}: guidance: {error}") from error


def limiter_parameters(live: LiveCase) -> LimiterParameters:
    """Parameters of ``limiter``; values that are not given keep their defaults."""
    try:
        return LimiterParameters(**live.limiter)
    except MarginGuardError as error:
        raise InputError(f"{live.case.manifest.file}: limiter: {error}") from error


def tumor_motion_parameters(live: LiveCase) -> TumorMotionParameters | None:
    """Parameters of ``tumor_motion``, None without it."""
    if live.tumor_motion is None:
        return None
    try:
        return TumorMotionParameters(**live.tumor_motion)
    except MarginGuardError as error:
        raise InputError(f"{live.case.manifest.file}: tumor_motion: {error}") from error
