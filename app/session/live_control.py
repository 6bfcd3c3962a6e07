"""How a live session limits twists and guides the hand, as its ``live.yaml`` asks for."""

from app.case import LiveCase
from app.fixture import GuidanceParameters, LimiterParameters
from app.geometry import InputError, MarginGuardError


def guidance_parameters(live: LiveCase) -> GuidanceParameters | None:
    """Those of ``guidance``, None without it; `InputError` for a force that is not passive."""
    if live.guidance is None:
        return None
    try:
        return GuidanceParameters(**live.guidance)
    except MarginGuardError as error:
        raise InputError(f"{live.case.manifest.file}: guidance: {error}") from error


def limiter_parameters(live: LiveCase) -> LimiterParameters:
    """Those of ``limiter``, with what is not given as it is otherwise."""
    try:
        return LimiterParameters(**live.limiter)
    except MarginGuardError as error:
        raise InputError(f"{live.case.manifest.file}: limiter: {error}") from error
