"""Commands of the page, and checks of values that it sends.

Each check returns the value as the server uses it.
"""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

from app.geometry import InputError
from app.viewer.address import Role, ViewerError


class MessageError(ViewerError):
    """The message has no meaning here; no page sends it. The connection is closed."""


class RefusedError(ViewerError):
    """The request is not one that this page may make. It is answered with this text."""


class NotDoneError(RefusedError):
    """A request that this page may make, but that cannot be done now.

    It is answered with this text and does not count among the page's refused requests.
    """


Check = Callable[[object], Any]
"""Returns the checked value; raises `RefusedError`."""

_SHOWN_CHARS = 40


def shown(value: object) -> str:
    """Short form of a value for a message: one line of ASCII."""
    text = ascii(value)
    return text if len(text) <= _SHOWN_CHARS else f"{text[:_SHOWN_CHARS]}..."


def refused(value: object, expected: str) -> RefusedError:
    """Return the error for a value that is not what was expected."""
    return RefusedError(f"value: {shown(value)}; expected {expected}")


def text(max_chars: int) -> Check:
    """A text of at most ``max_chars`` characters."""

    def check(value: object) -> str:
        if not isinstance(value, str) or len(value) > max_chars:
            raise refused(value, f"a text of at most {max_chars} characters")
        return value

    return check


def one_of(allowed: Collection[str], expected: str = "") -> Check:
    """One of the texts ``allowed``; ``expected`` describes them in a message."""

    def check(value: object) -> str:
        if not isinstance(value, str) or value not in allowed:
            raise refused(value, expected or f"one of {', '.join(allowed)}")
        return value

    return check


def number(low: float, high: float) -> Check:
    """A finite number from ``low`` to ``high``, as a float."""

    def check(value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise refused(value, f"a number from {low:g} to {high:g}")
        if not math.isfinite(value) or not low <= value <= high:
            raise refused(value, f"a number from {low:g} to {high:g}")
        return float(value)

    return check


def numbers(count: int, low: float, high: float) -> Check:
    """A list of ``count`` finite numbers from ``low`` to ``high``, as a tuple of floats."""
    each = number(low, high)

    def check(value: object) -> tuple[float, ...]:
        if not isinstance(value, list) or len(value) != count:
            raise refused(value, f"{count} numbers from {low:g} to {high:g}")
        return tuple(each(item) for item in value)

    return check


def integer(low: int, high: int) -> Check:
    """An integer from ``low`` to ``high``."""

    def check(value: object) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise refused(value, f"an integer from {low} to {high}")
        return value

    return check


def boolean(value: object) -> bool:
    """True or False."""
    if not isinstance(value, bool):
        raise refused(value, "true or false")
    return value


def flag(value: object) -> int:
    """0 or 1; browsers send False and True as well."""
    if value not in (0, 1) or not isinstance(value, int):
        raise refused(value, "0 or 1")
    return int(value)


def empty(value: object) -> None:
    """An empty list or mapping, or null."""
    if value not in ([], {}, None):
        raise refused(value, "nothing")


def mapping(value: object) -> dict[str, Any]:
    """A mapping."""
    if not isinstance(value, dict):
        raise refused(value, "a mapping")
    return value


@dataclass(frozen=True, slots=True)
class Command:
    """``call`` with arguments of these ``checks``, for a page that may do what needs ``role``.

    ``cost``: the number of messages that it counts for.
    """

    call: Callable[..., object]
    checks: tuple[Check, ...]
    role: Role
    cost: float = 1.0

    def checked(self, what: str, given: Collection[object], role: Role) -> list[Any]:
        """Check ``role`` and the arguments. Raises `RefusedError`, for the role with ``what``."""
        if not role.may(self.role):
            raise RefusedError(f"{what}: role {role.value}; expected {self.role.value}")
        if len(given) != len(self.checks):
            raise RefusedError(f"arguments: {len(given)}; expected {len(self.checks)}")
        return [check(value) for check, value in zip(self.checks, given, strict=True)]


class Commands:
    """The commands that exist, each with checks of its arguments and the role that may use it.

    ``changed()`` is called after each command that was done, to draw again.
    """

    def __init__(self, changed: Callable[[], None] = lambda: None) -> None:
        self._commands: dict[str, Command] = {}
        self._changed = changed

    def add(
        self, name: str, call: Callable[..., object], *checks: Check, role: Role = Role.OPERATE
    ) -> None:
        """Call ``call`` with the checked arguments at each command ``name``."""
        self._commands[name] = Command(call, checks, role)

    def run(self, name: str, args: Collection[object], role: Role) -> None:
        """Run a command for a page of ``role``.

        Raises `RefusedError` if there is no such command, or if role or arguments do not permit it,
        and `NotDoneError` for an `InputError` of the command.
        """
        command = self._commands.get(name)
        if command is None:
            raise RefusedError(
                f"command: {shown(name)}; expected one of {', '.join(self._commands)}"
            )
        values = command.checked(f"command {name}", args, role)
        try:
            command.call(*values)
        except InputError as error:
            raise NotDoneError(str(error)) from error
        self._changed()
