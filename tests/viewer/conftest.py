"""Fixtures: a served page and a browser that records its requests."""

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import (
    Browser,
    ConsoleMessage,
    Error,
    Locator,
    Page,
    Request,
    Route,
    ViewportSize,
)

from app.cli.replay_page import ReplayParts, replay_parts
from app.cli.signals import SignalState
from app.scene import OffscreenError, use_offscreen_rendering
from tests.viewer.viewed_case import write_viewed_case

SIZE = ViewportSize(width=1280, height=720)
TOKEN, VIEW_TOKEN = "only-for-this-test", "only-to-see"
TOKENS = ("--token", TOKEN, "--view-token", VIEW_TOKEN)
DEADLINE_S = 120.0


class Server:
    """``marginguard view``, or another command, in a process; constructed when it serves."""

    def __init__(self, arguments: list[str], log: Path, command: str = "view") -> None:
        self.log = log
        with log.open("w") as errors:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "app.cli", command, *arguments, *TOKENS],
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                env=dict(os.environ),
            )
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
        """Kill the process if it runs."""
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


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
        self.page.route("**/*", self._route)
        self.page.goto(url)
        self.page.wait_for_selector("body:not([data-lost]) #state-label")
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

    def _route(self, route: Route) -> None:
        if urlsplit(route.request.url).netloc == self.host:
            route.continue_()
        else:
            route.abort()


def reset(page: Page) -> None:
    """Pause the page, and show the first frame with the first camera."""
    page.set_viewport_size(SIZE)
    page.evaluate("document.activeElement.blur()")
    for key in ("ArrowLeft", "Home", "1"):
        page.keyboard.press(key)


def wait_until_uncovered(page: Page) -> None:
    """Wait for the heartbeat of a busy server, without which the page covers itself."""
    page.wait_for_selector("body:not([data-lost])")


def screenshot(part: Locator) -> bytes:
    """Picture of ``part`` without the page's cover."""
    while True:
        wait_until_uncovered(part.page)
        content = part.screenshot()
        if part.page.evaluate("!document.body.dataset.lost"):
            return content


@pytest.fixture(scope="session")
def can_draw() -> None:
    try:
        use_offscreen_rendering()
    except OffscreenError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def viewed_case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_viewed_case(tmp_path_factory.mktemp("viewed") / "case")


@pytest.fixture(scope="session")
def parts(viewed_case: Path) -> ReplayParts:
    """The case, stepped through in this process."""
    stepped = replay_parts(viewed_case, (), SignalState(), tip_only=False)
    assert stepped is not None
    return stepped


@pytest.fixture(scope="session")
def serve(can_draw: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serve]:
    """``serve("CASE", ...)`` starts a server, which is killed after the session."""
    started: list[Server] = []

    def start(*arguments: str) -> Server:
        log = tmp_path_factory.mktemp("view") / "log.txt"
        started.append(Server(list(arguments), log))
        return started[-1]

    yield start
    for server in started:
        server.close()


@pytest.fixture(scope="session")
def server(serve: Serve, viewed_case: Path) -> Server:
    return serve(str(viewed_case))


@contextmanager
def watching(browser: Browser, server: Server) -> Iterator[Watched]:
    """Open the page in a new browser context of `SIZE`."""
    context = browser.new_context(viewport=SIZE, accept_downloads=True)
    context.set_default_timeout(1000.0 * DEADLINE_S)
    watched = Watched(context.new_page(), server.host)
    try:
        watched.open(server.url)
    except Error as error:
        pytest.fail(f"{error}; log of the server: {server.log.read_text()!r}")
    yield watched
    context.close()


@pytest.fixture(scope="module")
def watched(browser: Browser, server: Server) -> Iterator[Watched]:
    with watching(browser, server) as watched:
        yield watched
