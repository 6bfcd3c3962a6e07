"""Errors of the scene."""

from app.geometry import MarginGuardError


class SceneError(MarginGuardError):
    """Something that the scene cannot show: an unknown frame, a name that is taken."""


class OffscreenError(MarginGuardError):
    """This machine cannot draw without a screen; the message names what to install."""
