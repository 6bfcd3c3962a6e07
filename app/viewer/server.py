"""Serves the page: trame with a gate before it, until it is told to stop or something fails."""

import asyncio
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import trame_rca.module
from aiohttp import web
from trame_rca.view_adapter import RcaViewAdapter
from trame_server import Server
from trame_slicer.views import ThreeDView

from app.viewer.address import Address
from app.viewer.auth import Gate
from app.viewer.controls import ReplayHands, StageHands
from app.viewer.drawing.area import PictureArea
from app.viewer.drawing.pictures import MakeSchedule, Pictures, Schedule
from app.viewer.drawing.scene_view import SceneView
from app.viewer.log_filter import ignore_closed_connections
from app.viewer.page import Page
from app.viewer.readout.state_style import band_patterns, state_css
from app.viewer.readout.timeline import Timeline
from app.viewer.steps.feeds import Feed
from app.viewer.steps.replay import ReplayControl
from app.viewer.websocket_link import PageLink

_WEB = Path(__file__).with_name("web")
_AREA = "stage"
_MOST_PIXELS = 1920 * 1200
"""Of a picture, however large the page is or says it is: the page stretches it."""


@dataclass(frozen=True, slots=True, eq=False)
class Title:
    """What the page says of the case; ``report`` makes its ``report.html``, None offers none."""

    case: str
    live: bool
    report: Callable[[], bytes] | None = None


class Viewer:
    """A page for ``feed``, with a stage to show it on. Made and run in one thread.

    ``control`` is that of a replay, None for a live session. ``area`` and ``schedule`` are what
    draws, and when: others are for measurements.
    """

    def __init__(
        self,
        stage: SceneView,
        feed: Feed,
        timeline: Timeline,
        title: Title,
        control: ReplayControl | None = None,
        *,
        area: Callable[[ThreeDView], PictureArea] = PictureArea,
        schedule: MakeSchedule = Pictures,
    ) -> None:
        self._schedule = schedule
        self._pictures: Schedule | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopped: asyncio.Event | None = None
        self._title = title
        self._server = _server(title)
        self._page = Page(self._server.state, stage, area(stage.view), feed, timeline)
        self._server.state.rates = []
        StageHands(self._server, stage, self._page.cameraman, self.redraw)
        if control is not None:
            ReplayHands(self._server, control, self.redraw)

    def redraw(self) -> None:
        """Draw as soon as possible, in the page's thread."""
        if self._pictures is not None:
            self._pictures.schedule_render()

    def look(self) -> None:
        """From any thread: the feed may have something new."""
        if self._loop is not None and self._pictures is not None:
            self._loop.call_soon_threadsafe(self._pictures.look)

    def stop(self) -> None:
        """From any thread: end `serve`."""
        if self._loop is not None and self._stopped is not None:
            self._loop.call_soon_threadsafe(self._stopped.set)

    async def serve(self, address: Address, on_ready: Callable[[str], None]) -> None:
        """Serve until `stop`; ``on_ready`` is told the URL, token and all, when it can be opened.

        Raises `ViewerError` where the address cannot be had, and whatever ends the pictures: a
        page without pictures must not go on.
        """
        self._loop, self._stopped = asyncio.get_running_loop(), asyncio.Event()
        link = PageLink(lambda page, number: pictures.has(page, number))
        pictures = self._pictures = self._schedule(self._page.area, self._page, link.beat)
        adapter = RcaViewAdapter(self._page.area, _AREA, scheduler=pictures)
        adapter.max_pixel_count = _MOST_PIXELS
        server = self._server
        server.add_protocol_to_configure(lambda protocol: protocol.registerLinkProtocol(link))
        server.controller.on_server_bind.add(lambda bound: self._open(bound.app, address))
        ignore_closed_connections()
        serving = asyncio.ensure_future(_start(server, address))
        ready = asyncio.ensure_future(server.ready)
        await asyncio.wait({serving, ready}, return_when=asyncio.FIRST_COMPLETED)
        if serving.done():
            _raise_of(serving, address)
        server.controller.rc_area_register(adapter)
        drawing = asyncio.create_task(pictures.run())
        stopping = asyncio.create_task(self._stopped.wait())
        on_ready(address.url(server.port))
        await asyncio.wait({serving, drawing, stopping}, return_when=asyncio.FIRST_COMPLETED)
        self._loop = None
        for task in (drawing, stopping):
            task.cancel()
        await server.stop()
        await asyncio.gather(serving, return_exceptions=True)
        if drawing.done() and not drawing.cancelled():
            drawing.result()

    def _open(self, app: web.Application, address: Address) -> None:
        Gate(address.token).protect(app)
        app.router.add_get("/marginguard/states.css", _state_css)
        app.router.add_static("/marginguard/", _WEB)
        app.router.add_post("/paraview/", _session)
        app.router.add_get("/screenshot.png", self._screenshot)
        if self._title.report is not None:
            app.router.add_get("/report.html", self._report)

    async def _screenshot(self, request: web.Request) -> web.Response:
        made = self._page.screenshot()
        self.redraw()  # the scene may be ahead of the pages now
        return _download(made, "image/png", "marginguard.png")

    async def _report(self, request: web.Request) -> web.Response:
        if self._title.report is None:
            raise web.HTTPNotFound
        made = await asyncio.get_running_loop().run_in_executor(None, self._title.report)
        return _download(made, "text/html", "report.html")


async def _state_css(request: web.Request) -> web.Response:
    return web.Response(text=state_css(), content_type="text/css")


async def _session(request: web.Request) -> web.Response:
    """Where the socket is: trame's page asks a launcher before it looks beside itself.

    The page fills in its own host, and encrypts where it came encrypted itself, through a proxy.
    """
    return web.json_response({"sessionURL": "ws://USE_HOST/ws", "id": "page"})


def _server(title: Title) -> Server:
    server = Server("marginguard")
    server.client_type = "vue3"
    server.enable_module(trame_rca.module)
    server.enable_module(
        {
            "styles": ["marginguard/states.css", "marginguard/page.css"],
            "module_scripts": ["marginguard/main.js"],
        }
    )
    state = server.state
    state.trame__title = f"{title.case} - MarginGuard"
    state.trame__favicon = "marginguard/icon.svg"
    state.trame__template_main = (_WEB / "page.html").read_text()
    # What trame shows when the connection is lost; the page's own watch lies over it.
    state.trame__template_error = '<div class="gone"></div>'
    state.patterns = band_patterns()
    state.title = {
        "case": title.case,
        "live": title.live,
        "report": title.report is not None,
    }
    return server


async def _start(server: Server, address: Address) -> None:
    # The program's arguments are not trame's, which would read them.
    server.cli.parse_known_args = partial(server.cli.parse_known_args, [])
    # Pictures are compressed already: the socket need not try.
    os.environ["WSLINK_WS_COMPRESS"] = "0"
    await server.start(
        exec_mode="coroutine",
        host=address.host,
        port=address.port,
        thread=True,  # signals are the command's
        timeout=0,
        open_browser=False,
        show_connection_info=False,
    )


def _raise_of(serving: "asyncio.Future[Any]", address: Address) -> None:
    error = serving.exception()
    raise address.refused(error) from error


def _download(content: bytes, kind: str, name: str) -> web.Response:
    disposition = f'attachment; filename="{name}"'
    return web.Response(
        body=content, content_type=kind, headers={"Content-Disposition": disposition}
    )
