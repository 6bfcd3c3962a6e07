"""Access to the page: only requests with the token are answered with content."""

import hmac
import secrets
from collections.abc import Awaitable, Callable
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Middleware

from app.viewer.address import new_token

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

_HEADERS = {
    # The browser refuses requests to other hosts.
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; "
    "style-src 'self' 'unsafe-inline'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "frame-ancestors 'none'; base-uri 'self'; form-action 'none'",
    # Cookies are shared by all ports of a host: pages of other servers must not embed content.
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


class Gate:
    """Admits requests that carry ``token``: once in the URL, then as a cookie.

    Applies to pages, static files and the websocket. All other requests, and requests from pages of
    other origins, are answered with status 403 and an empty body.
    """

    def __init__(self, token: str) -> None:
        self._token = token
        # Cookies are shared by all ports of a host: a random name keeps two viewers apart, and
        # a random value keeps the token from other servers.
        self._cookie, self._pass = f"marginguard_{secrets.token_hex(4)}", new_token()

    def protect(self, app: web.Application) -> None:
        """Check every request to ``app``."""
        app.middlewares.append(self._middleware())

    def _middleware(self) -> Middleware:
        @web.middleware
        async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
            origin = request.headers.get("Origin")
            if origin is not None and urlsplit(origin).netloc != request.host:
                return web.Response(status=403)
            if _same(request.query.get("token", ""), self._token):
                return self._admitted(request)
            if not _same(request.cookies.get(self._cookie, ""), self._pass):
                return web.Response(status=403)
            response = await handler(request)
            if not response.prepared:
                response.headers.update(_HEADERS)
            return response

        return check

    def _admitted(self, request: web.Request) -> web.Response:
        """Redirect to the page without the token: browsers keep URLs in their history."""
        response = web.Response(status=303, headers={"Location": "index.html", **_HEADERS})
        response.set_cookie(self._cookie, self._pass, httponly=True, samesite="Strict", path="/")
        return response


def _same(given: str, secret: str) -> bool:
    return hmac.compare_digest(given.encode(errors="backslashreplace"), secret.encode())
