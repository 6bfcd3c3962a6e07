"""Access to the page: tokens, host names, and limits on guesses and connections."""

import asyncio
import hmac
import secrets
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Iterable, Mapping
from ipaddress import IPv6Address, ip_address
from time import monotonic_ns
from typing import cast
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Middleware

from app.runtime.requests import RateLimit
from app.viewer.address import Role
from app.viewer.log import log

_LOCAL = "localhost"


class AllowedHosts:
    """The host names under which the page may be opened.

    A page of another server can give its own name the address of this machine (DNS rebinding); the
    browser then takes this page for a part of the other one. Such a request has the foreign name in
    its Host header. An address in digits cannot be rebound: it is always allowed, like localhost.
    """

    def __init__(self, names: Iterable[str] = ()) -> None:
        self._names = {_LOCAL, *(name.lower().rstrip(".") for name in names)}

    def allows(self, host_header: str | None) -> bool:
        """True if the request was sent to a name that is allowed. The port does not matter."""
        name = _host_name(f"//{host_header}") if host_header else None
        return name is not None and (name in self._names or _is_address(name))


def is_same_origin(origin: str | None, host_header: str | None) -> bool:
    """True if a page of the origin (scheme, host, port) was served under this Host header.

    The scheme is not compared: a proxy may add TLS.
    """
    if not origin or not host_header:
        return False
    parts = origin.split("://", 1)
    return parts[0] in ("http", "https") and len(parts) == 2 and parts[1] == host_header


def _host_name(url: str) -> str | None:
    """The host of ``url`` in lower case; None if it has user, path or a port that is no number."""
    try:
        parts = urlsplit(url)
        _ = parts.port
    except ValueError:
        return None
    if parts.path or parts.query or parts.fragment or "@" in parts.netloc or not parts.hostname:
        return None
    return parts.hostname.rstrip(".")


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


GUESSES = 10
"""Wrong tokens that an address may send at once."""
_PER_S = GUESSES / 60.0
_MAX_ADDRESSES = 1024
_NETWORK_BITS = 64
"""Bits of an IPv6 address that are not the choice of one machine."""


class GuessLimit:
    """Counts wrong tokens: `GUESSES` at once and as many a minute, for each address.

    The clock is passed in.
    """

    def __init__(self) -> None:
        self._limits: OrderedDict[str, RateLimit] = OrderedDict()

    def wrong(self, address: str | None, now_ns: int) -> bool:
        """Record a wrong token; return False if the address has sent too many."""
        key = _key(address)
        limit = self._limits.pop(key, None) or RateLimit(_PER_S, GUESSES)
        self._limits[key] = limit  # the newest one is last
        while len(self._limits) > _MAX_ADDRESSES:
            self._limits.popitem(last=False)
        return limit.take(now_ns)

    def is_blocked(self, address: str | None, now_ns: int) -> bool:
        """True while the address may not send another token."""
        limit = self._limits.get(_key(address))
        return limit is not None and not limit.has(now_ns)


def _key(address: str | None) -> str:
    """The address, or the network of an IPv6 address."""
    try:
        parsed = ip_address((address or "").partition("%")[0])
    except ValueError:
        return address or ""
    if isinstance(parsed, IPv6Address):
        return str(int(parsed) >> (128 - _NETWORK_BITS))
    return str(parsed)


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


Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

ROLE = web.RequestKey("marginguard.role", Role)
"""Key of a request's `Role`."""
UNGUESSABLE_CHARS = 22
"""A token of this length, 128 bits if it is random, opens the page in spite of wrong guesses."""

_HEADERS = {
    # The browser refuses requests to other hosts.
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; "
    "style-src 'self' 'unsafe-inline'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "frame-ancestors 'none'; base-uri 'self'; form-action 'none'",
    # Cookies are shared by all ports of a host: pages of other servers must not embed content.
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


class RequestAuthenticator:
    """Admits requests that carry a token: once in the URL, then as a cookie.

    ``tokens`` gives the token of each role. It applies to pages, static files and the
    websocket. All other requests, and requests from pages of other origins or to names that are
    not allowed, are answered with status 403 and an empty body, and their connection is closed.
    """

    def __init__(
        self, tokens: Mapping[Role, str], hosts: AllowedHosts, connections: ConnectionLimits
    ) -> None:
        self._tokens = dict(tokens)
        self._hosts = hosts
        self._connections = connections
        self._guesses = GuessLimit()
        # Cookies are shared by all ports of a host: a random name keeps two viewers apart, and
        # random values keep the tokens from other servers.
        self._cookie = f"marginguard_{secrets.token_hex(4)}"
        self._passes = {role: secrets.token_urlsafe(24) for role in tokens}

    def middleware(self) -> Middleware:
        """Check of every request; the request of a handler has its `ROLE`."""

        @web.middleware
        async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
            origin = request.headers.get("Origin")
            if not self._hosts.allows(request.headers.get("Host")):
                return _refusal()
            if origin is not None and not is_same_origin(origin, request.headers.get("Host")):
                return _refusal()
            if token := request.query.get("token"):
                return self._opened(request, token)
            role = _role_of(request.cookies.get(self._cookie, ""), self._passes)
            if role is None:
                return _refusal()
            if not self._connections.admit(request.transport, role):
                return _refusal(503)
            request[ROLE] = role
            return await _answer(request, handler)

        return check

    def _opened(self, request: web.Request, token: str) -> web.Response:
        """Redirect to the page without the token: browsers keep URLs in their history."""
        now_ns = monotonic_ns()
        blocked = self._guesses.is_blocked(request.remote, now_ns)
        role = _role_of(token, self._tokens)
        if role is None:
            counted = self._guesses.wrong(request.remote, now_ns)
            return _refusal(403 if counted else 429)
        if blocked and len(token) < UNGUESSABLE_CHARS:
            return _refusal(429)
        response = web.Response(status=303, headers={"Location": "index.html", **_HEADERS})
        response.set_cookie(
            self._cookie, self._passes[role], httponly=True, samesite="Strict", path="/"
        )
        response.force_close()
        return response


async def _answer(request: web.Request, handler: Handler) -> web.StreamResponse:
    """The handler's response; an error is logged here, and is not described to the client."""
    try:
        response = await handler(request)
    except web.HTTPException as answer:
        response = web.Response(status=answer.status, headers=_location(answer))
    except ConnectionError:
        raise
    except Exception:
        log.exception("request %s", ascii(request.path)[:200])
        response = web.Response(status=500)
    if not response.prepared:
        response.headers.update(_HEADERS)
    return response


def _location(answer: web.HTTPException) -> dict[str, str]:
    location = answer.headers.get("Location")
    return {} if location is None else {"Location": location}


def _refusal(status: int = 403) -> web.Response:
    response = web.Response(status=status)
    response.force_close()
    return response


def _role_of(given: str, secrets_of: Mapping[Role, str]) -> Role | None:
    """The role whose secret is ``given``; each comparison takes the same time."""
    found = None
    for role, secret in secrets_of.items():
        if hmac.compare_digest(given.encode(errors="backslashreplace"), secret.encode()):
            found = role
    return found
