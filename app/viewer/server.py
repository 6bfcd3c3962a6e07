"""Serves the page by trame, behind a check of the token."""

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
from app.viewer.controls import ReplayControls, SceneControls
from app.viewer.drawing.area import PictureArea
from app.viewer.drawing.pictures import MakeScheduler, RenderLoop, RenderScheduler
from app.viewer.drawing.scene_view import SceneView
from app.viewer.log_filter import ignore_closed_connections
from app.viewer.page import Page
from app.viewer.readout.state_style import band_patterns, state_css
from app.viewer.readout.timeline import Timeline
from app.viewer.steps.feeds import Feed
from app.viewer.steps.replay import ReplayControl
from app.viewer.websocket_link import PageLink

_WEB = Path(__file__).with_name("web")
_AREA = "scene"
_MAX_PIXELS = 1920 * 1200
"""Limit of a picture's size; a larger page stretches the picture."""


@dataclass(frozen=True, slots=True, eq=False)
class Title:
    """The case in the page's title; ``report`` makes its ``report.html``, None for no report."""

    case: str
    live: bool
    report: Callable[[], bytes] | None = None


class Viewer:
    """A page that shows ``feed`` in ``view``. Create and run it in one thread.

    ``control`` is that of a replay, None for a live session. ``area`` and ``scheduler`` draw the
    picture; benchmarks replace them.
    """

    def __init__(
        self,
        view: SceneView,
        feed: Feed,
        timeline: Timeline,
        title: Title,
        control: ReplayControl | None = None,
        *,
        area: Callable[[ThreeDView], PictureArea] = PictureArea,
        scheduler: MakeScheduler = RenderLoop,
    ) -> None:
        self._make_scheduler = scheduler
        self._scheduler: RenderScheduler | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopped: asyncio.Event | None = None
        self._title = title
        self._server = _server(title)
        self._page = Page(self._server.state, view, area(view.view), feed, timeline)
        self._server.state.rates = []
        SceneControls(self._server, view, self._page.camera, self.redraw)
        if control is not None:
            ReplayControls(self._server, control, self.redraw)

    def redraw(self) -> None:
        """Draw as soon as possible, in the page's thread."""
        if self._scheduler is not None:
            self._scheduler.schedule_render()

    def wake(self) -> None:
        """Check soon whether the feed has a new step; from any thread."""
        if self._loop is not None and self._scheduler is not None:
            self._loop.call_soon_threadsafe(self._scheduler.wake)

    def stop(self) -> None:
        """End `serve`; from any thread."""
        if self._loop is not None and self._stopped is not None:
            self._loop.call_soon_threadsafe(self._stopped.set)

    async def serve(self, address: Address, on_ready: Callable[[str], None]) -> None:
        """Serve until `stop`; call ``on_ready`` with the URL and its token when it can be opened.

        Raises `ViewerError` if the address cannot be used, and any error that ends the render loop,
        because a page without pictures must not continue.
        """
        self._loop, self._stopped = asyncio.get_running_loop(), asyncio.Event()
        link = PageLink(lambda page, number: scheduler.acknowledge(page, number))
        scheduler = self._scheduler = self._make_scheduler(self._page.area, self._page, link.beat)
        adapter = RcaViewAdapter(self._page.area, _AREA, scheduler=scheduler)
        adapter.max_pixel_count = _MAX_PIXELS
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
        drawing = asyncio.create_task(scheduler.run())
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
        content = self._page.screenshot()
        self.redraw()  # the scene may be newer than the pages' picture
        return _download(content, "image/png", "marginguard.png")

    async def _report(self, request: web.Request) -> web.Response:
        if self._title.report is None:
            raise web.HTTPNotFound
        content = await asyncio.get_running_loop().run_in_executor(None, self._title.report)
        return _download(content, "text/html", "report.html")


async def _state_css(request: web.Request) -> web.Response:
    return web.Response(text=state_css(), content_type="text/css")


async def _session(request: web.Request) -> web.Response:
    """The URL of the websocket, which trame's page requests from a launcher first.

    The page fills in its own host, and uses TLS if it was loaded by TLS through a proxy.
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
    # Shown by trame when the connection is lost; the page's own overlay covers it.
    state.trame__template_error = '<div class="gone"></div>'
    state.patterns = band_patterns()
    state.title = {
        "case": title.case,
        "live": title.live,
        "report": title.report is not None,
    }
    return server


async def _start(server: Server, address: Address) -> None:
    # Keep trame from reading the arguments of this program.
    server.cli.parse_known_args = partial(server.cli.parse_known_args, [])
    # Pictures are compressed already.
    os.environ["WSLINK_WS_COMPRESS"] = "0"
    await server.start(
        exec_mode="coroutine",
        host=address.host,
        port=address.port,
        thread=True,  # the command handles signals
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
