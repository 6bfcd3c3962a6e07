"""Limits on network connections, before and after a request on them was admitted."""

import asyncio
from collections.abc import Callable
from typing import cast

from app.viewer.access.role import Role

MAX_PENDING = 32
"""Connections on which no request was admitted yet; a further one closes the oldest of them."""
MAX_ADMITTED = 64
"""Connections for each role; a browser uses up to six for a page, and one for its socket."""
PENDING_S = 10.0
"""Time for the first request."""
STALL_S = 20.0
"""Time in which a client must read what is being sent to it."""


class ConnectionLimits:
    """Counts the connections of a server; closes those that hold a place without using it."""

    def __init__(self) -> None:
        self._pending: dict[asyncio.BaseTransport, asyncio.TimerHandle] = {}
        self._admitted: dict[asyncio.BaseTransport, Role] = {}

    def limited(self, make: Callable[[], asyncio.Protocol]) -> Callable[[], asyncio.Protocol]:
        """Return a factory of ``make``'s protocols under these limits, for a listening socket."""
        return lambda: _LimitedProtocol(make(), self)

    def admit(self, transport: asyncio.BaseTransport | None, role: Role) -> bool:
        """Record that a request was admitted; return False if the role has too many connections."""
        if transport is None or self._admitted.get(transport) is role:
            return transport is not None
        if sum(each is role for each in self._admitted.values()) >= MAX_ADMITTED:
            return False
        timer = self._pending.pop(transport, None)
        if timer is not None:
            timer.cancel()
        self._admitted[transport] = role
        return True

    def opened(self, transport: asyncio.Transport) -> None:
        """Record a new connection."""
        while len(self._pending) >= MAX_PENDING:
            oldest = next(iter(self._pending))
            self._pending.pop(oldest).cancel()
            cast(asyncio.Transport, oldest).abort()
        loop = asyncio.get_running_loop()
        self._pending[transport] = loop.call_later(PENDING_S, transport.abort)

    def closed(self, transport: asyncio.BaseTransport) -> None:
        """Forget a connection."""
        self._admitted.pop(transport, None)
        timer = self._pending.pop(transport, None)
        if timer is not None:
            timer.cancel()


class _LimitedProtocol(asyncio.Protocol):
    """Forwards the events of a connection to ``inner``, and closes it when it stalls."""

    def __init__(self, inner: asyncio.Protocol, limits: ConnectionLimits) -> None:
        self._inner = inner
        self._limits = limits
        self._transport: asyncio.Transport | None = None
        self._stalled: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        self._limits.opened(self._transport)
        self._inner.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        self._end_stall()
        if self._transport is not None:
            self._limits.closed(self._transport)
        self._inner.connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        self._inner.data_received(data)

    def eof_received(self) -> bool | None:
        return self._inner.eof_received()

    def pause_writing(self) -> None:
        if self._transport is not None and self._stalled is None:
            loop = asyncio.get_running_loop()
            self._stalled = loop.call_later(STALL_S, self._transport.abort)
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        self._end_stall()
        self._inner.resume_writing()

    def _end_stall(self) -> None:
        if self._stalled is not None:
            self._stalled.cancel()
            self._stalled = None
