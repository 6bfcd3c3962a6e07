"""Errors of the files that a live session keeps on disk."""

from app.geometry import MarginGuardError


class StateFileError(MarginGuardError):
    """The record of the last run cannot be used, or that of this run cannot be written."""


class SecondInstanceError(MarginGuardError):
    """Another guard has the same namespace or the same arm."""
