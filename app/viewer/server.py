"""Serves the page: trame keeps its values, `WebServer` and `PageSocket` connect browsers."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import trame_rca.module
import trame_vtk.modules.common
from aiohttp import web
from trame_rca.view_adapter import RcaViewAdapter
from trame_server import Server
from trame_slicer.views import ThreeDView

from app.case import ImageSource
from app.files.volume_file import Volume
from app.runtime import SimulatedWorld
from app.viewer.address import Address, ViewerError
from app.viewer.contour_part import ContourControls, ContourPart
from app.viewer.controls import (
    LiveControls,
    add_image_controls,
    add_marker_controls,
    add_note_controls,
    add_replay_controls,
    add_scene_controls,
)
from app.viewer.downloads import Downloads
from app.viewer.drawing.client_scene import ClientScene
from app.viewer.drawing.render_loop import (
    LOAD_BESIDE_CONTROLLER,
    ClientLoop,
    MakeScheduler,
    PictureArea,
    RenderLoop,
    RenderScheduler,
)
from app.viewer.drawing.scene_view import SceneView
from app.viewer.feeds import Feed, ReplayControl
from app.viewer.guided_part import TIP_FILES, GuidedPart, add_guided_controls
from app.viewer.image_part import ImagePart, image_kinds
from app.viewer.live_operator import LiveOperator
from app.viewer.log import limit_logs
from app.viewer.messages.checks import Commands
from app.viewer.messages.methods import Methods
from app.viewer.messages.open_pages import OpenPages
from app.viewer.messages.page_socket import PageSocket
from app.viewer.page import Page
from app.viewer.plan_part import GoalDrag, PlanPart, add_goal_controls, add_plan_controls
from app.viewer.pointer_parts import BodyDrag, HandPart, MouseHand, PointerArea, PointerPart
from app.viewer.timeline import Timeline, band_patterns, state_css
from app.viewer.web_app import Content, Handle, WebServer
from app.viewer.world_part import BodyUpload, WorldControls, WorldPart
from app.workflow import ApproachGhost, EventNotes, GoalPose, NeedleGuide, Workflow

_WEB = Path(__file__).with_name("web")
_AREA = "scene"
_MAX_PIXELS = 1920 * 1200
"""Limit of a picture's size; a larger page stretches the picture."""


@dataclass(frozen=True, slots=True, eq=False)
class Title:
    """The case in the page's title; ``exports`` makes its files by name, ``images`` are shown.

    ``missing``: by file name, why a file is not among ``exports``. ``volume`` is cut through the
    tool's tip; its axes are those of the tumour's frame. ``notes``: those of operators, which the
    page lists and adds to.
    """

    case: str
    live: bool
    exports: Mapping[str, Callable[[], bytes]] = field(default_factory=dict)
    missing: Mapping[str, str] = field(default_factory=dict)
    images: ImageSource | None = None
    volume: Volume | None = None
    notes: EventNotes = field(default_factory=EventNotes)


class Viewer:
    """A page that shows ``feed`` in ``view``. Create and run it in one thread.

    ``control`` is that of a replay, ``operator`` that of a live session. ``area`` and ``scheduler``
    draw the picture; benchmarks replace them. ``client``: the browser draws the scene by WebGL.
    ``hand``: the mouse of an operator drags the tool; not with ``client``, whose cameras are not
    known here. ``world``: a simulated one, whose bodies ``view`` shows, too. ``plans``: an approach
    and a needle's corridor, which ``view`` shows, too; ``goal`` with ``plans``: an operator may
    move the robot's ghost to a goal.
    """

    def __init__(
        self,
        view: SceneView,
        feed: Feed,
        timeline: Timeline,
        title: Title,
        control: ReplayControl | None = None,
        *,
        operator: LiveOperator | None = None,
        area: Callable[[ThreeDView], PictureArea] = PictureArea,
        scheduler: MakeScheduler | None = None,
        client: bool = False,
        hand: MouseHand | None = None,
        world: SimulatedWorld | None = None,
        plans: tuple[ApproachGhost, NeedleGuide] | None = None,
        goal: GoalPose | None = None,
    ) -> None:
        if client and hand is not None:
            raise ViewerError("page: drawn by the browser, with a hand; expected one of both")
        loop: MakeScheduler = ClientLoop if client else RenderLoop
        if hand is not None:
            loop = partial(RenderLoop, max_load=LOAD_BESIDE_CONTROLLER)
        self._make_scheduler = scheduler or loop
        self._scheduler: RenderScheduler | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopped: asyncio.Event | None = None
        self._title = title
        self._operator = operator
        self._server = _server(title, client=client)
        state = self._server.state
        client_scene = ClientScene(view) if client else None
        kinds = image_kinds(title.images, title.volume)
        self._images = ImagePart(title.images, title.volume) if kinds else None
        self._hand = None if hand is None else HandPart(view, hand)
        self._contour = (
            ContourPart(view.content, self.wake, operator)
            if operator is not None or title.images is not None
            else None
        )
        self._guided = None
        if operator is not None:
            self._guided = GuidedPart(Workflow(view.content, operator, self.wake))
        self._world = None if world is None else WorldPart(world)
        self._pointed: list[PointerPart] = [] if self._hand is None else [self._hand]
        if world is not None and not client:
            self._pointed.append(BodyDrag(view, world))
        if goal is not None and not client:
            self._pointed.append(GoalDrag(view, goal, self.redraw))
        self._page = Page(
            state,
            view,
            area(view.view),
            feed,
            timeline,
            client_scene,
            self._images,
            self._hand,
            self._contour,
            title.notes,
            operator,
            self._guided,
            self._world,
            None if plans is None else PlanPart(*plans, goal),
        )
        state.rates = []
        self._commands = commands = Commands(self.redraw)
        add_scene_controls(state, commands, view, self._page.camera)
        add_marker_controls(state, commands, view)
        if control is not None:
            add_replay_controls(state, commands, control)
        if operator is not None:
            LiveControls(commands, operator)
        add_note_controls(commands, title.notes, lambda: self._page.shown, operator)
        if self._images is not None:
            add_image_controls(commands, self._images, kinds)
        if self._contour is not None:
            ContourControls(commands, self._contour, live=operator is not None)
        if self._guided is not None:
            add_guided_controls(commands, self._guided.workflow)
        if world is not None:
            WorldControls(commands, world)
        if plans is not None:
            add_plan_controls(commands, *plans)
        if goal is not None:
            add_goal_controls(commands, goal)

    @property
    def workflow(self) -> Workflow | None:
        """The guided recordings of a live session; None in a replay."""
        return None if self._guided is None else self._guided.workflow

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

    async def serve(self, address: Address, on_ready: Callable[[int], None]) -> None:
        """Serve until `stop`; call ``on_ready`` with the port when the page can be opened.

        Raises `ViewerError` if the address cannot be used, and any error that ends the render loop,
        because a page without pictures must not continue.
        """
        self._loop, self._stopped = asyncio.get_running_loop(), asyncio.Event()
        limit_logs()
        hand = self._hand
        pages = OpenPages(self._gone)
        scheduler = self._scheduler = self._make_scheduler(self._page.area, self._page, pages.beat)
        adapter = RcaViewAdapter(self._page.area, _AREA, scheduler=scheduler)
        adapter.max_pixel_count = _MAX_PIXELS

        def acknowledge(page: str, number: int) -> None:
            if hand is not None:
                hand.heard(page)
            scheduler.acknowledge(page, number)

        pointed = PointerArea(adapter, self._pointed)
        methods = Methods(self._server, self._commands, _AREA, pointed, acknowledge)
        sockets = PageSocket(pages, methods)
        folders: dict[str, Path] = {}
        self._server.controller.on_server_bind.add(lambda bound: folders.update(_folders(bound)))
        state_server = asyncio.ensure_future(_start(self._server))
        await self._server.ready
        for protocol in self._server.protocol.getLinkProtocols():
            # Trame publishes to the pages; the command alone ends the server.
            protocol.init(pages.publish, lambda content: content, lambda: None)
        web_server = WebServer(address, self._content(sockets, folders))
        port = await web_server.start()
        self._server.controller.rc_area_register(adapter)
        drawing = asyncio.create_task(scheduler.run())
        stopping = asyncio.create_task(self._stopped.wait())
        on_ready(port)
        await asyncio.wait({drawing, stopping}, return_when=asyncio.FIRST_COMPLETED)
        self._loop = None
        for task in (drawing, stopping):
            task.cancel()
        await sockets.close()
        await web_server.stop()
        await self._server.stop()
        if self._operator is not None:
            self._operator.close()
        if self._contour is not None:
            self._contour.close()
        if self._guided is not None:
            self._guided.workflow.close()
        await asyncio.gather(state_server, return_exceptions=True)
        if drawing.done() and not drawing.cancelled():
            drawing.result()

    def _gone(self, page: str) -> None:
        for part in self._pointed:
            part.gone(page)

    def _content(self, sockets: PageSocket, folders: dict[str, Path]) -> Content:
        downloads = Downloads(
            self._screenshot, self._title.exports, lambda: len(self._title.notes.entries)
        )
        handlers = {
            "/ws": sockets.handle,
            "/marginguard/states.css": _state_css,
            "/screenshot.png": downloads.screenshot,
        }
        handlers |= {f"/{name}": downloads.export for name in self._title.exports}
        if self._contour is not None:
            handlers |= {"/contour.stl": self._contour.file, "/contour.ply": self._contour.file}
        if self._guided is not None:
            handlers |= {f"/{name}": self._guided.file for name in TIP_FILES}
        posts: dict[str, Handle] = {"/paraview/": _session}
        if self._world is not None:
            posts["/body/{name}"] = BodyUpload(self._world.world).post
        return Content(handlers, {**folders, "/marginguard/": _WEB}, posts)

    def _screenshot(self) -> bytes:
        content = self._page.screenshot()
        self.redraw()  # the scene may be newer than the pages' picture
        return content


async def _state_css(request: web.Request) -> web.Response:
    return web.Response(text=state_css(), content_type="text/css")


async def _session(request: web.Request) -> web.Response:
    """The URL of the websocket, which trame's page requests from a launcher first.

    The page fills in its own host, and uses TLS if it was loaded by TLS through a proxy.
    """
    return web.json_response({"sessionURL": "ws://USE_HOST/ws", "id": "page"})


def _server(title: Title, *, client: bool) -> Server:
    server = Server("marginguard")
    server.client_type = "vue3"
    server.enable_module(trame_rca.module)
    server.enable_module(
        {
            "styles": [
                "marginguard/states.css",
                "marginguard/page.css",
                "marginguard/ultrasound.css",
                "marginguard/contour.css",
                "marginguard/calibration.css",
                "marginguard/world.css",
                "marginguard/plan.css",
            ],
            "module_scripts": ["marginguard/main.js"],
        }
    )
    if client:
        server.enable_module(trame_vtk.modules.common)
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
        "exports": list(title.exports),
        "missing": [f"{name}: {why}" for name, why in title.missing.items()],
        "client": client,
        "ultrasound": title.images is not None,
        "images": list(image_kinds(title.images, title.volume)),
        "contour": title.live or title.images is not None,
    }
    return server


def _folders(bound: Any) -> dict[str, Path]:
    """The folders of trame's files, by their paths."""
    return {f"/{path.strip('/')}": Path(folder) for path, folder in bound.config["static"].items()}


async def _start(server: Server) -> None:
    """Run trame without a network: pages are connected by `PageSocket`."""
    # Keep trame from reading the arguments of this program.
    server.cli.parse_known_args = partial(server.cli.parse_known_args, [])
    await server.start(
        backend="generic",
        exec_mode="coroutine",
        thread=True,  # the command handles signals
        timeout=0,
        open_browser=False,
        show_connection_info=False,
    )
