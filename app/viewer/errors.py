"""Errors of the viewer."""

from app.geometry import MarginGuardError


class ViewerError(MarginGuardError):
    """The page cannot be served, or a value of a control is out of range."""
