"""Exceptions of MarginGuard, all derived from `MarginGuardError`.

A message is one line with the place, the rejected value and the allowed values.
"""

MAX_MESSAGE = 1200
"""Limit for the characters of a message: names and values of a file can have any length."""

_KEPT = MAX_MESSAGE // 2 - 20


class MarginGuardError(Exception):
    """Base class of all errors that MarginGuard raises deliberately.

    >>> import marginguard as mg
    >>> try:
    ...     mg.Transform("sensor", "tumor", 2.0, [0, 0, 0])
    ... except mg.MarginGuardError as error:
    ...     print(error)
    rotation of sensor_from_tumor has shape (); expected (3, 3)

    A message that contains text of a file stays one printable line: line breaks become spaces,
    other control characters their escapes, and the middle of a long message is left out.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(_one_line(str(message)))


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


def _one_line(message: str) -> str:
    """Return ``message`` as one printable line of at most `MAX_MESSAGE` characters."""
    if len(message) > MAX_MESSAGE:
        left_out = len(message) - 2 * _KEPT
        message = f"{message[:_KEPT]}...({left_out} characters)...{message[-_KEPT:]}"
    if message.isprintable():
        return message
    line = " ".join(message.splitlines())
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
