"""The web server: routes behind the check of tokens, and a listening socket under limits."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from aiohttp import web

from app.viewer.access_control import AllowedHosts, ConnectionLimits, RequestAuthenticator
from app.viewer.address import Address

Handle = Callable[[web.Request], Awaitable[web.StreamResponse]]

_IDLE_S = 20.0
"""A connection without a request is closed after this time."""
_LINGER_S = 1.0
"""Time for the rest of a request that was answered already."""
_MAX_LINE_BYTES, _MAX_HEADERS = 8190, 64
_BACKLOG = 64


@dataclass(frozen=True, slots=True, eq=False)
class Content:
    """Content of the server: handlers of paths, and folders below paths."""

    handlers: Mapping[str, Handle]
    folders: Mapping[str, Path]
    posts: Mapping[str, Handle] = field(default_factory=dict)


class WebServer:
    """Listens at an address. `start` and `stop` are called once each."""

    def __init__(self, address: Address, content: Content) -> None:
        self._address = address
        self._connections = ConnectionLimits()
        names = (address.host, *address.names)
        authenticator = RequestAuthenticator(address.tokens, AllowedHosts(names), self._connections)
        self._app = web.Application(middlewares=[authenticator.middleware()])
        self._runner = web.AppRunner(
            self._app,
            handle_signals=False,
            access_log=None,
            keepalive_timeout=_IDLE_S,
            lingering_time=_LINGER_S,
            max_line_size=_MAX_LINE_BYTES,
            max_field_size=_MAX_LINE_BYTES,
            max_headers=_MAX_HEADERS,
            shutdown_timeout=1.0,
        )
        self._listening: asyncio.Server | None = None
        self._add(content)

    def _add(self, content: Content) -> None:
        router = self._app.router
        router.add_get("/", _to_index)
        for path, handle in content.handlers.items():
            router.add_get(path, handle, allow_head=False)
        for path, handle in content.posts.items():
            router.add_post(path, handle)
        # The first route that matches is used: the longest paths come first.
        for path in sorted(content.folders, key=len, reverse=True):
            router.add_static(path, content.folders[path])

    async def start(self) -> int:
        """Listen; return the port. Raises `ViewerError` if the address cannot be used."""
        await self._runner.setup()
        server = self._runner.server
        if server is None:
            raise RuntimeError("web server: not set up")
        loop = asyncio.get_running_loop()
        try:
            self._listening = await loop.create_server(
                self._connections.limited(server),
                self._address.host,
                self._address.port,
                backlog=_BACKLOG,
            )
        except (OSError, UnicodeError) as error:
            raise self._address.refused(error) from error
        return int(self._listening.sockets[0].getsockname()[1])

    async def stop(self) -> None:
        """Close all connections."""
        if self._listening is not None:
            self._listening.close()
        await self._runner.cleanup()


async def _to_index(request: web.Request) -> web.Response:
    raise web.HTTPFound("index.html")


def refusal(error: Exception) -> web.Response:
    """Answer with the text of ``error`` to a request that cannot be done."""
    return web.json_response({"problem": " ".join(str(error).split())}, status=409)
