"""The methods that a page may call: what is not listed here does not exist for it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from trame_server import Server

from app.viewer.access.role import Role
from app.viewer.log import log
from app.viewer.messages.checks import (
    Check,
    arguments,
    empty,
    integer,
    mapping,
    one_of,
    refused,
    shown,
    text,
)
from app.viewer.messages.commands import Commands
from app.viewer.messages.errors import RefusedError
from app.viewer.messages.events import Event, area_size, pointer_event
from app.viewer.messages.open_pages import OpenPage
from app.viewer.messages.wire import MAX_MESSAGE_BYTES

HELLO = "wslink.hello"
"""The first message of a page."""
_LIFE_CYCLE = ("client_connected", "client_unmounted", "client_exited")
_MAX_COMMAND_ARGS = 6
_MAX_ERRORS_LOGGED, _MAX_ERROR_CHARS = 5, 400
_STATE_COST = 20.0
"""Cost of sending the whole state, in messages."""
_name = text(64)


class Area(Protocol):
    """The picture's area, as trame's `RcaViewAdapter` offers it."""

    def update_size(self, origin: str, size: dict[str, float], /) -> None:
        """Use the size of the area on the page."""

    def on_interaction(self, origin: str, event: Event, /) -> None:
        """Process an event of the pointer."""


@dataclass(frozen=True, slots=True)
class _Method:
    call: Callable[..., object]
    checks: tuple[Check, ...]
    role: Role
    cost: float = 1.0


class Methods:
    """Runs the calls of pages. ``area_name`` is the name of ``area`` on the page.

    ``on_ack(page, number)`` is called when a page has received picture ``number``.
    """

    def __init__(
        self,
        server: Server,
        commands: Commands,
        area_name: str,
        area: Area,
        on_ack: Callable[[str, int], None],
    ) -> None:
        self._server = server
        self._commands = commands
        self._area = area
        self._on_ack = on_ack
        place = (one_of([area_name]), _name)
        view, operate = Role.VIEW, Role.OPERATE
        self._methods = {
            HELLO: _Method(self._greet, (mapping,), view),
            "trame.state.get": _Method(self._state, (), view, _STATE_COST),
            "trame.lifecycle.update": _Method(_ignore, (one_of(_LIFE_CYCLE),), view),
            "trame.error.client": _Method(_log_error, (text(MAX_MESSAGE_BYTES),), view),
            "marginguard.seen": _Method(self._acknowledge, (integer(0, 2**53),), view),
            # The role that a command needs is checked with its name.
            "trame.trigger": _Method(self._run, (_name, _command_args, empty), view),
            "trame.rca.size": _Method(self._resize, (*place, area_size), operate),
            "trame.rca.event": _Method(self._interact, (*place, pointer_event), operate),
        }

    def cost(self, method: str) -> float:
        """The number of messages that a call counts for."""
        known = self._methods.get(method)
        return 1.0 if known is None else known.cost

    def call(self, page: OpenPage, name: str, args: tuple[Any, ...]) -> object:
        """Run a call of ``page`` and return its result.

        Raises `RefusedError` if there is no such method, or if role or arguments do not permit it.
        """
        method = self._methods.get(name)
        if method is None:
            raise RefusedError(f"method: {shown(name)}; expected one that the page uses")
        if not page.role.may(method.role):
            raise RefusedError(
                f"method {name}: role {page.role.value}; expected {method.role.value}"
            )
        return method.call(page, *arguments(args, method.checks))

    def _greet(self, page: OpenPage, _secret: object) -> dict[str, object]:
        """The socket's request has proved the token; wslink's own secret is a constant."""
        page.greeted = True
        return {"clientID": page.id, "maxMsgSize": MAX_MESSAGE_BYTES}

    def _state(self, page: OpenPage) -> dict[str, object]:
        whole = self._server.protocol.get_server_state()
        # The page sends none of its values: only the server changes them.
        own = {"role": page.role.value, "trame__client_only": [*whole["state"], "role"]}
        return {**whole, "state": {**whole["state"], **own}}

    def _acknowledge(self, page: OpenPage, number: int) -> None:
        page.acknowledge(number)
        self._on_ack(page.id, number)

    def _run(self, page: OpenPage, name: str, args: list[object], _kwargs: None) -> None:
        with self._server.state:
            self._commands.run(name, args, page.role)

    def _resize(self, page: OpenPage, _area: str, _origin: str, size: dict[str, float]) -> None:
        self._area.update_size(page.id, size)

    def _interact(self, page: OpenPage, _area: str, _origin: str, event: Event | None) -> None:
        if event is not None:
            self._area.on_interaction(page.id, event)


def _command_args(value: object) -> list[object]:
    if not isinstance(value, list) or len(value) > _MAX_COMMAND_ARGS:
        raise refused(value, f"a list of at most {_MAX_COMMAND_ARGS} values")
    return value


def _ignore(_page: OpenPage, _event: str) -> None:
    """Nothing here depends on a page's life cycle."""


def _log_error(page: OpenPage, message: str) -> None:
    """Log the first errors of a page's scripts, each in one line of ASCII."""
    page.errors_logged += 1
    if page.errors_logged <= _MAX_ERRORS_LOGGED:
        log.error("%s: error in the browser: %s", page.id, ascii(message)[:_MAX_ERROR_CHARS])
