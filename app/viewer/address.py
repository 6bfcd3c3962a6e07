"""Address, tokens and roles of the page."""

import asyncio
import os
import secrets
from dataclasses import dataclass, field
from enum import Enum
from urllib.parse import quote

from app.geometry import MarginGuardError


class Role(Enum):
    """Permissions of a page. The token with which it was opened decides."""

    VIEW = "view"
    """See everything, change nothing: neither the replay nor the picture that all pages share."""
    OPERATE = "operate"
    """Also use the controls."""

    def may(self, required: "Role") -> bool:
        """True if a page of this role may do what needs ``required``."""
        return self is required or self is Role.OPERATE


class ViewerError(MarginGuardError):
    """The page cannot be served, or a value of a control is out of range."""


_LAST_PORT = 65_535


def new_token() -> str:
    """Return a random token of 24 bytes."""
    return secrets.token_urlsafe(24)


@dataclass(frozen=True, slots=True, eq=False)
class Address:
    """Where to serve; ``port`` 0 selects a free one.

    ``token`` admits a browser that may use the controls, ``view_token`` one that may not.
    ``names`` are further host names under which the page may be opened, e.g. that of a proxy.

    Raises `ViewerError` for a port out of range, for equal tokens, and for an empty host, which
    would mean all addresses of this machine.
    """

    host: str
    port: int
    token: str
    view_token: str = field(default_factory=new_token)
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.host:
            raise ViewerError(
                "host: empty; expected an address, e.g. 127.0.0.1 (local) or 0.0.0.0 (all)"
            )
        if not 0 <= self.port <= _LAST_PORT:
            raise ViewerError(f"port: {self.port}; expected 0 (a free one) to {_LAST_PORT}")
        if self.token == self.view_token:
            raise ViewerError("view token: the same as the other token; expected two tokens")

    @property
    def tokens(self) -> dict[Role, str]:
        """The token of each role."""
        return {Role.OPERATE: self.token, Role.VIEW: self.view_token}

    def url(self, port: int, role: Role = Role.OPERATE) -> str:
        """Return the URL of the page with the token of ``role``; ``port`` is the bound port."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/?token={quote(self.tokens[role], safe='')}"

    def check(self) -> None:
        """Raise `ViewerError` if the address cannot be bound. Call it before the page is built."""
        asyncio.run(self._listen_once())

    def refused(self, error: BaseException | None) -> ViewerError:
        """Return the error for a page that cannot be served here, with the cause."""
        cause: object = error or "the server ended"
        if isinstance(error, OSError) and error.errno is not None:
            # asyncio's message repeats the address. A name that is not found has a number below 0.
            cause = os.strerror(error.errno) if error.errno > 0 else error.strerror
        return ViewerError(f"the page cannot be served at {self.host} port {self.port}: {cause}")

    async def _listen_once(self) -> None:
        try:
            loop = asyncio.get_running_loop()
            server = await loop.create_server(asyncio.Protocol, self.host, self.port)
        except (OSError, UnicodeError) as error:
            raise self.refused(error) from error
        server.close()
        await server.wait_closed()
