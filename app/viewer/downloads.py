"""Files that the page offers: the present picture, and the report and exports of a replay."""

import asyncio
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic_ns

from aiohttp import web

from app.geometry import InputError, MarginGuardError
from app.runtime.requests import RateLimit
from app.viewer.access_control import ROLE
from app.viewer.address import Role

_PICTURES_PER_S, _PICTURE_BURST = 2.0, 4.0


KINDS = {
    ".csv": "text/csv",
    ".gif": "image/gif",
    ".html": "text/html",
    ".mp4": "video/mp4",
    ".mrb": "application/zip",
    ".pdf": "application/pdf",
}
"""Ending of an export: its type."""

Write = Callable[[Path], object]
"""Writes the file of this path."""


class Downloads:
    """Handlers of downloads. ``exports``: by file name, what makes the file of a replay.

    A picture is drawn in the page's thread, so their rate is limited for all pages together. An
    export is computed once for each ``version`` of what is in it, one at a time.
    """

    def __init__(
        self,
        screenshot: Callable[[], bytes],
        exports: Mapping[str, Callable[[], bytes]],
        version: Callable[[], object] = lambda: None,
    ) -> None:
        self._screenshot = screenshot
        self._exports = dict(exports)
        self._version = version
        self._pictures = RateLimit(_PICTURES_PER_S, _PICTURE_BURST)
        self._one_at_a_time = threading.Lock()
        self._computing: dict[str, tuple[object, asyncio.Future[bytes]]] = {}

    async def screenshot(self, request: web.Request) -> web.Response:
        """The present picture as PNG."""
        if not self._pictures.take(monotonic_ns()):
            return web.Response(status=429)
        return _download(self._screenshot(), "image/png", "marginguard.png")

    async def export(self, request: web.Request) -> web.Response:
        """The file that the last part of the path names; status 409 and why it cannot be made."""
        name = request.path.rpartition("/")[2]
        make = self._exports.get(name)
        if make is None:
            raise web.HTTPNotFound
        version, computing = self._version(), self._computing.get(name)
        if computing is None or computing[0] != version:
            future = asyncio.get_running_loop().run_in_executor(None, self._made, make)
            computing = self._computing[name] = (version, future)
        try:
            content = await asyncio.shield(computing[1])
        except MarginGuardError as error:
            return web.Response(status=409, text=" ".join(str(error).split()))
        return _download(content, KINDS[f".{name.rpartition('.')[2]}"], name)

    def _made(self, make: Callable[[], bytes]) -> bytes:
        with self._one_at_a_time:
            return make()


async def operators_file(
    request: web.Request, kind: str, prepare: Callable[[], Write]
) -> web.Response:
    """The file that the last part of the path names, for operators alone.

    ``prepare`` returns what writes it, and raises `InputError` with why it cannot be made: 409.
    """
    if not request[ROLE].may(Role.OPERATE):
        raise web.HTTPForbidden
    name = request.path.rpartition("/")[2]
    try:
        write = prepare()
    except InputError as error:
        return web.Response(status=409, text=str(error))
    loop = asyncio.get_running_loop()
    return _download(await loop.run_in_executor(None, _written, name, write), kind, name)


def _written(name: str, write: Write) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def _download(content: bytes, kind: str, name: str) -> web.Response:
    disposition = f'attachment; filename="{name}"'
    return web.Response(
        body=content, content_type=kind, headers={"Content-Disposition": disposition}
    )
