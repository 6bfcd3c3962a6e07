"""The errors of MarginGuard: one root, so that a caller can catch them all.

A message shows the value that was refused, where it stood, and what was allowed, on one line.
"""


class MarginGuardError(Exception):
    """Root of every error that MarginGuard raises on purpose."""


class FrameError(MarginGuardError):
    """Two values whose frames do not meet, or a name that cannot be a frame."""


class TransformError(MarginGuardError):
    """Numbers that are not a rigid transform: not finite, reflected, scaled, sheared."""


class StampError(MarginGuardError):
    """Stamps of different clocks were compared, or a time that cannot be a stamp."""


class MeshError(MarginGuardError):
    """A surface that cannot be used: not finite, empty, open, or with faces out of range."""


class InputError(MarginGuardError):
    """A file, a field or an argument of the user that cannot be used."""
