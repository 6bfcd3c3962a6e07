"""Exceptions of MarginGuard, all derived from `MarginGuardError`.

A message is one line with the place, the rejected value and the allowed values.
"""


class MarginGuardError(Exception):
    """Base class of all errors that MarginGuard raises deliberately."""


class FrameError(MarginGuardError):
    """Frames of two values do not match, or a frame name is invalid."""


class TransformError(MarginGuardError):
    """Numbers are not a rigid transform: not finite, reflected, scaled or sheared."""


class StampError(MarginGuardError):
    """Stamps of different clocks are compared, or a time is out of range."""


class MeshError(MarginGuardError):
    """A surface is not finite, empty, open, or has face indices out of range."""


class InputError(MarginGuardError):
    """A file, a field or an argument given by the user is invalid."""
