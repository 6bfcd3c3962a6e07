"""Files that the page offers: the present picture, and the report of a replay."""

import asyncio
from collections.abc import Callable
from time import monotonic_ns

from aiohttp import web

from app.runtime.rate_limit import RateLimit

_PICTURES_PER_S, _PICTURE_BURST = 2.0, 4.0


class Downloads:
    """Handlers of downloads. ``report`` makes its file, None for no report.

    A picture is drawn in the page's thread, so their rate is limited for all pages together. The
    report is computed once for each ``version`` of what is in it.
    """

    def __init__(
        self,
        screenshot: Callable[[], bytes],
        report: Callable[[], bytes] | None,
        version: Callable[[], object] = lambda: None,
    ) -> None:
        self._screenshot = screenshot
        self._report = report
        self._version = version
        self._computed: object = None
        self._pictures = RateLimit(_PICTURES_PER_S, _PICTURE_BURST)
        self._computing: asyncio.Future[bytes] | None = None

    async def screenshot(self, request: web.Request) -> web.Response:
        """The present picture as PNG."""
        if not self._pictures.take(monotonic_ns()):
            return web.Response(status=429)
        return _download(self._screenshot(), "image/png", "marginguard.png")

    async def report(self, request: web.Request) -> web.Response:
        """The report as HTML."""
        if self._report is None:
            raise web.HTTPNotFound
        version = self._version()
        if self._computing is None or version != self._computed:
            self._computed = version
            loop = asyncio.get_running_loop()
            self._computing = loop.run_in_executor(None, self._report)
        content = await asyncio.shield(self._computing)
        return _download(content, "text/html", "report.html")


def _download(content: bytes, kind: str, name: str) -> web.Response:
    disposition = f'attachment; filename="{name}"'
    return web.Response(
        body=content, content_type=kind, headers={"Content-Disposition": disposition}
    )
