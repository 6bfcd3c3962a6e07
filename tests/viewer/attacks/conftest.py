"""A served page under attack, and what must hold after each attack."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.viewer.attacks.raw_page import RawPage, cookie, raw_page
from tests.viewer.conftest import TOKEN, VIEW_TOKEN, Server

MAX_GROWTH = 1.5


@dataclass
class Target:
    """The server, and the cookies of its two roles."""

    server: Server
    operate: str
    view: str

    @property
    def log(self) -> str:
        return self.server.log.read_text()

    @contextmanager
    def bounded(self) -> Iterator[None]:
        """Check that the server lives, and that its memory stays below 1.5 times what it was."""
        folder = Path(f"/proc/{self.server.process.pid}")
        (folder / "clear_refs").write_text("5")  # the peak begins anew
        before = _kilobytes(folder, "VmRSS")
        yield
        assert self.server.process.poll() is None, self.log
        assert _kilobytes(folder, "VmHWM") < MAX_GROWTH * before


def _kilobytes(folder: Path, name: str) -> int:
    lines = (folder / "status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{name}:"))


@pytest.fixture(scope="module")
def target(server: Server) -> Target:
    return Target(server, cookie(server, TOKEN), cookie(server, VIEW_TOKEN))


@pytest.fixture
def operator(target: Target) -> Iterator[RawPage]:
    with raw_page(target.server, target.operate) as page:
        yield page.greet()


@pytest.fixture
def viewer(target: Target) -> Iterator[RawPage]:
    with raw_page(target.server, target.view) as page:
        yield page.greet()
