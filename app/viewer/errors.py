"""What can go wrong in the viewer."""

from app.geometry import MarginGuardError


class ViewerError(MarginGuardError):
    """Something that the page cannot do: a port that is taken, a control out of its range."""
