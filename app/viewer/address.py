"""Where the page is served, and what opens it."""

import asyncio
import os
import secrets
from dataclasses import dataclass
from urllib.parse import quote

from app.viewer.errors import ViewerError

_LAST_PORT = 65_535


def new_token() -> str:
    """A token that nobody guesses."""
    return secrets.token_urlsafe(24)


@dataclass(frozen=True, slots=True, eq=False)
class Address:
    """Where to serve: ``port`` 0 takes one that is free; ``token`` opens the gate.

    Raises `ViewerError` for a port that there is not, and for no host at all, which would be all
    addresses of this machine.
    """

    host: str
    port: int
    token: str

    def __post_init__(self) -> None:
        if not self.host:
            raise ViewerError("the host is empty: 127.0.0.1 is this machine alone, 0.0.0.0 all")
        if not 0 <= self.port <= _LAST_PORT:
            raise ViewerError(f"port {self.port}: 0 (one that is free) to {_LAST_PORT} wanted")

    def url(self, port: int) -> str:
        """What opens the page, token and all, where ``port`` is the one that was taken."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/?token={quote(self.token, safe='')}"

    def check(self) -> None:
        """Raise `ViewerError` where nobody can serve now: to be asked before there is a page."""
        asyncio.run(self._listen_once())

    def refused(self, error: BaseException | None) -> ViewerError:
        """That the page cannot be served here, and why."""
        why: object = error or "it ended"
        if isinstance(error, OSError) and error.errno is not None:
            # asyncio's words repeat the address; a name that is not found has a number below 0.
            why = os.strerror(error.errno) if error.errno > 0 else error.strerror
        return ViewerError(f"the page cannot be served at {self.host} port {self.port}: {why}")

    async def _listen_once(self) -> None:
        try:
            loop = asyncio.get_running_loop()
            server = await loop.create_server(asyncio.Protocol, self.host, self.port)
        except (OSError, UnicodeError) as error:
            raise self.refused(error) from error
        server.close()
        await server.wait_closed()
