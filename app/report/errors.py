"""What can go wrong while a report is made."""

from app.geometry import MarginGuardError


class ReportError(MarginGuardError):
    """A report that cannot be made: a folder that cannot be written, or a row without sense."""
