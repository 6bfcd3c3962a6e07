"""Values of the API that all other parts use."""

from app.geometry import InputError, MarginGuardError, Transform

__all__ = ["InputError", "MarginGuardError", "Transform"]
