"""Exceptions of MarginGuard, all derived from `MarginGuardError`.

A message is one line with the place, the rejected value and the allowed values.
"""


class MarginGuardError(Exception):
    """Base class of all errors that MarginGuard raises deliberately.

    >>> import marginguard as mg
    >>> try:
    ...     mg.Transform("needle", "tumor", 2.0, [0, 0, 0])
    ... except mg.MarginGuardError as error:
    ...     print(error)
    rotation of needle_from_tumor has shape (); expected (3, 3)
    """


class FrameError(MarginGuardError):
    """Frames of two values do not match, or a frame name is invalid."""


class TransformError(MarginGuardError):
    """Numbers are not a rigid transform: not finite, reflected, scaled or sheared."""


class StampError(MarginGuardError):
    """Stamps of different clocks are compared, or a time is out of range."""


class MeshError(MarginGuardError):
    """A surface is not finite, empty, open, or has face indices out of range."""


class InputError(MarginGuardError):
    """A file, a field or an argument given by the user is invalid.

    >>> import marginguard as mg
    >>> try:
    ...     mg.open_case("no_such_case")
    ... except mg.InputError as error:
    ...     print(error)
    no_such_case is not a case: no such folder
    """
