"""Errors of the report."""

from app.geometry import MarginGuardError


class ReportError(MarginGuardError):
    """The report cannot be made: its folder is not writable, or a row has an invalid value."""
