"""Serves the page of a case library, with the access rules of the replay page."""

import asyncio
import os
import re
import tempfile
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from time import monotonic_ns

from aiohttp import web

from app.files.zip_folder import unpack_folder
from app.fixture import MarginState
from app.geometry import InputError, MarginGuardError
from app.runtime.requests import RateLimit
from app.viewer.access_control import ROLE
from app.viewer.address import Address, Role
from app.viewer.case_library import MANIFEST, CaseLibrary
from app.viewer.log import limit_logs
from app.viewer.web_app import Content, WebServer, refusal

OpenPage = Callable[[Path], Awaitable[dict[Role, str]]]
"""Opens the replay page of a case; returns its URL for each role. Raises `InputError`."""

_WEB = Path(__file__).with_name("web")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_NAME_EXPECTED = "at most 64 letters, digits, '_', '-' and '.', the first a letter or a digit"
_CHUNK_BYTES = 1 << 16
_UPLOAD_S = 1800.0


class LibraryServer:
    """Lists, opens, and with ``max_upload_bytes`` above 0 takes cases of ``library``.

    Viewers see the list and the page that an operator has opened; they open and upload nothing.
    An upload is a zip file of one case. It is unpacked and replayed beside the library, and
    appears only if both succeed. One upload and one opening run at a time.
    """

    def __init__(self, library: CaseLibrary, open_page: OpenPage, max_upload_bytes: int) -> None:
        self._library = library
        self._open_page = open_page
        self._max_bytes = max_upload_bytes
        self._opened: tuple[str, dict[Role, str]] | None = None
        self._opening, self._uploading = asyncio.Lock(), asyncio.Lock()
        self._refreshes = RateLimit(per_s=1.0, burst=2.0)
        self._stopped = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None

    def stop(self) -> None:
        """End `serve`; from any thread."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._stopped.set)

    async def serve(self, address: Address, on_ready: Callable[[int], None]) -> None:
        """Serve until `stop`; call ``on_ready`` with the port. Raises `ViewerError`."""
        self._loop = asyncio.get_running_loop()
        limit_logs()
        posts = {"/open/{name}": self._open}
        if self._max_bytes > 0:
            posts["/upload/{name}"] = self._upload
        handlers = {
            "/index.html": self._index,
            "/library.json": self._list,
            "/picture/{name}": self._picture,
        }
        server = WebServer(address, Content(handlers, {"/marginguard/": _WEB}, posts))
        on_ready(await server.start())
        try:
            await self._stopped.wait()
        finally:
            await server.stop()

    async def _index(self, request: web.Request) -> web.StreamResponse:
        return web.FileResponse(_WEB / "library.html")

    async def _list(self, request: web.Request) -> web.Response:
        # Pages together read the files of all cases once a second at most.
        if self._refreshes.take(monotonic_ns()):
            loop = asyncio.get_running_loop()
            try:
                await loop.run_in_executor(None, self._library.refresh)
            except InputError as error:
                return refusal(error)
        role = request[ROLE]
        opened = None
        if self._opened is not None:
            opened = {"folder": self._opened[0], "url": self._opened[1][role]}
        return web.json_response(
            {
                "cases": self._library.rows(),
                "operates": role is Role.OPERATE,
                "opened": opened,
                "labels": {state.name: state.display.label for state in MarginState},
                "max_upload_bytes": self._max_bytes if role is Role.OPERATE else 0,
            }
        )

    async def _picture(self, request: web.Request) -> web.Response:
        content = self._library.picture(request.match_info["name"])
        if content is None:
            raise web.HTTPNotFound
        return web.Response(body=content, content_type="image/png")

    async def _open(self, request: web.Request) -> web.Response:
        if request[ROLE] is not Role.OPERATE:
            raise web.HTTPForbidden
        name = request.match_info["name"]
        if self._opening.locked():
            return refusal(InputError("open: another case is being opened; expected to wait"))
        async with self._opening:
            try:
                folder = self._library.folder(name)
                self._opened = None
                urls = await self._open_page(folder)
            except MarginGuardError as error:
                return refusal(error)
            self._opened = name, urls
        return web.json_response({"url": urls[Role.OPERATE]})

    async def _upload(self, request: web.Request) -> web.Response:
        if request[ROLE] is not Role.OPERATE:
            raise web.HTTPForbidden
        name = request.match_info["name"]
        try:
            if self._uploading.locked():
                raise InputError("upload: another one is running; expected to wait for it")
            async with self._uploading:
                await self._take(request, name)
        except MarginGuardError as error:
            return refusal(error)
        except OSError as error:
            return refusal(InputError(f"upload: failed: {error.strerror or 'it took too long'}"))
        return web.json_response({"folder": name})

    async def _take(self, request: web.Request, name: str) -> None:
        target = self._library.root / name
        if not _NAME.fullmatch(name):
            raise InputError(f"upload: the name is {name[:80]!r}; expected {_NAME_EXPECTED}")
        if os.path.lexists(target):
            raise InputError(f"upload: {name} already exists; refusing to overwrite it")
        if (request.content_length or 0) > self._max_bytes:
            raise self._too_large()
        loop = asyncio.get_running_loop()
        # On the file system of the library, so that the case appears by one rename.
        with tempfile.TemporaryDirectory(prefix=".upload-", dir=self._library.root) as folder:
            archive, unpacked = Path(folder, "case.zip"), Path(folder, name)
            async with asyncio.timeout(_UPLOAD_S):
                await self._receive(request, archive)
            await loop.run_in_executor(None, unpack_folder, archive, unpacked, MANIFEST)
            await loop.run_in_executor(None, self._library.checked, unpacked)
            if os.path.lexists(target):
                raise InputError(f"upload: {name} already exists; refusing to overwrite it")
            unpacked.rename(target)
        with suppress(InputError):
            self._library.refresh()

    async def _receive(self, request: web.Request, archive: Path) -> None:
        received = 0
        with archive.open("xb") as file:
            async for data in request.content.iter_chunked(_CHUNK_BYTES):
                received += len(data)
                if received > self._max_bytes:
                    raise self._too_large()
                file.write(data)

    def _too_large(self) -> InputError:
        return InputError(
            f"upload: larger than {self._max_bytes >> 20} MiB; expected a smaller zip file"
        )
