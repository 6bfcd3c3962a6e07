"""Who may see the page: whoever knows the token, and nobody else sees a single byte."""

import hmac
import secrets
from collections.abc import Awaitable, Callable
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Middleware

from app.viewer.address import new_token

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

_HEADERS = {
    # The browser itself refuses whatever would leave this machine.
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; "
    "style-src 'self' 'unsafe-inline'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "frame-ancestors 'none'; base-uri 'self'; form-action 'none'",
    # Cookies are shared by the ports of a host: no other server's page may show what is here.
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


class Gate:
    """Lets requests pass that carry ``token``: in the address once, then a cookie for it.

    Pages, static files and the websocket alike; anything else is answered with 403 and no word.
    A request that another site's page sends has no business here either, cookie or not.
    """

    def __init__(self, token: str) -> None:
        self._token = token
        # Cookies are shared by the ports of a host: two viewers keep apart by the name, and what
        # other servers are sent is not the token.
        self._cookie, self._pass = f"marginguard_{secrets.token_hex(4)}", new_token()

    def close(self, app: web.Application) -> None:
        """Put the gate before everything that ``app`` serves."""
        app.middlewares.append(self._middleware())

    def _middleware(self) -> Middleware:
        @web.middleware
        async def gate(request: web.Request, handler: Handler) -> web.StreamResponse:
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

        return gate

    def _admitted(self, request: web.Request) -> web.Response:
        """To the page, without the token: an address is kept in places where no token belongs."""
        response = web.Response(status=303, headers={"Location": "index.html", **_HEADERS})
        response.set_cookie(self._cookie, self._pass, httponly=True, samesite="Strict", path="/")
        return response


def _same(given: str, secret: str) -> bool:
    return hmac.compare_digest(given.encode(errors="backslashreplace"), secret.encode())
