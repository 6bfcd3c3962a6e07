"""Commands of the page: the triggers that its buttons and keys send."""

from collections.abc import Callable, Collection
from dataclasses import dataclass

from app.geometry import InputError
from app.viewer.access.role import Role
from app.viewer.messages.checks import Check, arguments, shown
from app.viewer.messages.errors import NotDoneError, RefusedError


@dataclass(frozen=True, slots=True)
class _Command:
    call: Callable[..., None]
    checks: tuple[Check, ...]
    role: Role


class Commands:
    """The commands that exist, each with checks of its arguments and the role that may use it."""

    def __init__(self) -> None:
        self._commands: dict[str, _Command] = {}

    def add(
        self, name: str, call: Callable[..., None], *checks: Check, role: Role = Role.OPERATE
    ) -> None:
        """Call ``call`` with the checked arguments at each command ``name``."""
        self._commands[name] = _Command(call, checks, role)

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
        if not role.may(command.role):
            raise RefusedError(f"command {name}: role {role.value}; expected {command.role.value}")
        values = arguments(args, command.checks)
        try:
            command.call(*values)
        except InputError as error:
            raise NotDoneError(str(error)) from error
