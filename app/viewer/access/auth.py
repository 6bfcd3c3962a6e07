"""Access to the page: only requests with a token are answered with content."""

import hmac
import secrets
from collections.abc import Awaitable, Callable, Mapping
from time import monotonic_ns

from aiohttp import web
from aiohttp.typedefs import Middleware

from app.viewer.access.connections import ConnectionLimits
from app.viewer.access.guesses import GuessLimit
from app.viewer.access.hosts import AllowedHosts, is_same_origin
from app.viewer.access.role import Role
from app.viewer.log import log

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
