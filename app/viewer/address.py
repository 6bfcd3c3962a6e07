"""Host, port and token of the page."""

import asyncio
import os
import secrets
from dataclasses import dataclass
from urllib.parse import quote

from app.viewer.errors import ViewerError

_LAST_PORT = 65_535


def new_token() -> str:
    """Return a random token of 24 bytes."""
    return secrets.token_urlsafe(24)


@dataclass(frozen=True, slots=True, eq=False)
class Address:
    """Where to serve; ``port`` 0 selects a free one, ``token`` admits a browser.

    Raises `ViewerError` for a port out of range and for an empty host, which would mean all
    addresses of this machine.
    """

    host: str
    port: int
    token: str

    def __post_init__(self) -> None:
        if not self.host:
            raise ViewerError(
                "host: empty; expected an address, e.g. 127.0.0.1 (local) or 0.0.0.0 (all)"
            )
        if not 0 <= self.port <= _LAST_PORT:
            raise ViewerError(f"port: {self.port}; expected 0 (a free one) to {_LAST_PORT}")

    def url(self, port: int) -> str:
        """Return the URL of the page with its token; ``port`` is the bound port."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/?token={quote(self.token, safe='')}"

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
