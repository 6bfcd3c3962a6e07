"""Errors of the viewer."""

from app.geometry import MarginGuardError


class ViewerError(MarginGuardError):
    """The page cannot do a request: the port is in use, or a control value is out of range."""
