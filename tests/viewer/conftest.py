"""Fixtures: a served page and a browser that records its requests."""

import re
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from urllib.parse import urlsplit

import psutil
import pytest
from playwright.sync_api import Browser, ConsoleMessage, Error, Page, Request, ViewportSize

from app.cli.process import SignalState
from app.cli.replay_page import ReplayParts, replay_parts
from tests.forking import VIEW, warm_parent
from tests.ros_domain import domain_id as domain_id
from tests.viewer.page_actions import press, show_frame, wait_until_uncovered
from tests.viewer.viewed_case import write_viewed_case

SIZE = ViewportSize(width=1280, height=720)
TOKEN, VIEW_TOKEN = "only-for-this-test", "only-to-see"
TOKENS = ("--token", TOKEN, "--view-token", VIEW_TOKEN)
DEADLINE_S = 600.0
"""Ends a hang; far above what a load of the machine needs."""


class Server:
    """``marginguard view`` in a process; constructed when it serves."""

    def __init__(self, arguments: list[str], log: Path) -> None:
        self.log = log
        with log.open("w") as errors:
            command = ["-m", "app.cli", "view", *arguments, *TOKENS]
            self.process = warm_parent(VIEW).start(command, stderr=errors.fileno())
        deadline = threading.Timer(DEADLINE_S, self.process.kill)
        deadline.start()
        assert self.process.stdout is not None
        self.url = self.process.stdout.readline().strip()
        self.view_url = self.process.stdout.readline().strip().removeprefix("view only: ")
        deadline.cancel()
        if not self.url:
            pytest.fail(f"status {self.process.wait()}: {log.read_text()!r}")

    @property
    def host(self) -> str:
        """Host and port."""
        return urlsplit(self.url).netloc

    def close(self) -> None:
        """Kill the process if it runs, and the live node that it has started."""
        children = (
            psutil.Process(self.process.pid).children() if self.process.poll() is None else []
        )
        self.process.kill()
        for child in children:
            with suppress(psutil.NoSuchProcess):
                child.kill()
        self.process.wait()
        self.process.close()


Serve = Callable[..., Server]


@dataclass
class Watched:
    """A page with its requests and its console errors."""

    page: Page
    host: str
    requests: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    def open(self, url: str) -> Page:
        """Open the page and record its requests; requests to other hosts are aborted."""
        self.page.on("request", self._on_request)
        self.page.on("websocket", lambda socket: self.requests.append(socket.url))
        self.page.on("console", self._on_console)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        others = re.compile(rf"^(?!http://{re.escape(self.host)}/)")
        self.page.route(others, lambda route: route.abort())
        self.page.goto(url)
        wait_until_uncovered(self.page)
        return self.page

    def external_requests(self) -> list[str]:
        """URLs of other hosts that were requested."""
        own = [f"{scheme}://{self.host}/" for scheme in ("http", "ws")]
        local = (*own, f"blob:http://{self.host}/", "data:")
        return [url for url in self.requests if not url.startswith(local)]

    def _on_request(self, request: Request) -> None:
        self.requests.append(request.url)

    def _on_console(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            self.errors.append(message.text)


@pytest.fixture(scope="session")
def viewed_case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_viewed_case(tmp_path_factory.mktemp("viewed") / "case")


@pytest.fixture(scope="session")
def parts(viewed_case: Path) -> ReplayParts:
    """The case, stepped through in this process."""
    stepped = replay_parts(viewed_case, (), SignalState(), tip_only=False)
    assert stepped is not None
    return stepped


@contextmanager
def _servers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serve]:
    """``start("CASE", ...)`` starts a server, which is killed at the end of the context."""
    with ExitStack() as stack:

        def start(*arguments: str) -> Server:
            server = Server(list(arguments), tmp_path_factory.mktemp("view") / "log.txt")
            stack.callback(server.close)
            return server

        yield start


@pytest.fixture(scope="module")
def start_server(can_draw: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serve]:
    """``start_server("CASE", ...)``: a server of its own, which a test may kill."""
    with _servers(tmp_path_factory) as start:
        yield start


@pytest.fixture(scope="session")
def shared_server(can_draw: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serve]:
    """``shared_server("CASE", ...)``: the one server of these arguments."""
    with _servers(tmp_path_factory) as start:
        yield cache(start)


@pytest.fixture(scope="module")
def serve(shared_server: Serve) -> Iterator[Serve]:
    """``serve("CASE", ...)``: the shared server of these arguments; it runs during modules only.

    A replay that went on between them would take processor time from other tests.
    """
    used: set[Server] = set()

    def resume(*arguments: str) -> Server:
        server = shared_server(*arguments)
        if server not in used:
            used.add(server)
            server.process.send_signal(signal.SIGCONT)
        return server

    yield resume
    for server in used:
        server.process.send_signal(signal.SIGSTOP)


@pytest.fixture(scope="module")
def server(serve: Serve, viewed_case: Path) -> Server:
    return serve(str(viewed_case))


@pytest.fixture
def serve_live(can_draw: None, request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Serve]:
    """``serve_live(CONFIG, ...)`` starts a live session with a page, killed after the test."""
    pytest.importorskip("rclpy", reason="ROS 2 is not installed")
    request.getfixturevalue("domain_id")
    with ExitStack() as stack:

        def start(config: Path, *arguments: str) -> Server:
            words = ["--live", "--config", str(config), *arguments]
            server = Server(words, tmp_path / "view.txt")
            stack.callback(server.close)
            return server

        yield start


@contextmanager
def watching(
    browser: Browser, server: Server, url: str = "", script: str = ""
) -> Iterator[Watched]:
    """Open the operator's page, or that at ``url``, in a new browser context of `SIZE`.

    ``script`` runs before those of the page.
    """
    context = browser.new_context(viewport=SIZE, accept_downloads=True)
    context.set_default_timeout(1000.0 * DEADLINE_S)
    watched = Watched(context.new_page(), server.host)
    watched.page.add_init_script(script)
    try:
        watched.open(url or server.url)
    except Error as error:
        pytest.fail(f"{error}; log of the server: {server.log.read_text()!r}")
    yield watched
    context.close()


@pytest.fixture(scope="module")
def watched(browser: Browser, server: Server) -> Iterator[Watched]:
    with watching(browser, server) as watched:
        yield watched


@pytest.fixture
def page(watched: Watched) -> Page:
    """The page at its first size, paused at the first frame, with the first camera."""
    page = watched.page
    page.set_viewport_size(SIZE)
    press(page, "1")
    show_frame(page, 0)
    return page
