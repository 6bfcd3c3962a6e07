"""The control topics: the constraint at 1 kHz, the allowed twist, the guidance, what sets them."""

from app.bridge.control.constraint_stream import ConstraintStream

__all__ = ["ConstraintStream"]
