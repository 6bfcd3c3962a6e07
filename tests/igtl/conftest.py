"""A pyigtl server in another process, and a plain socket for invalid data."""

import json
import signal
import socket
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bridge.conftest import start as start
from tests.bridge.conftest import start_receiver as start_receiver
from tests.bridge.conftest import started_in
from tests.bridge.processes import DEADLINE_S as DEADLINE_S
from tests.bridge.processes import Child
from tests.ros_domain import domain_id as domain_id

PEER = Path(__file__).resolve().parents[1] / "oracles" / "pyigtl_peer.py"


class PyigtlServer(Child):
    """pyigtl server in another process."""

    @cached_property
    def port(self) -> int:
        """The port, which is the first line that the process prints."""
        return int(self.line().removeprefix("port "))

    def send(self, **message: Any) -> None:  # type: ignore[override]
        """Let the server send a message."""
        super().send(json.dumps(message))

    def kill(self) -> None:
        """Kill the process."""
        self.end(signal.SIGKILL)


@pytest.fixture
def start_pyigtl(tmp_path: Path) -> Iterator[Callable[..., PyigtlServer]]:
    """``start_pyigtl(port=0)`` starts a server, which is killed after the test."""
    with started_in(tmp_path) as begin:

        def start(port: int = 0) -> PyigtlServer:
            server: PyigtlServer = begin(PyigtlServer, PEER, port)
            assert server.port
            return server

        yield start


@pytest.fixture
def listening() -> Iterator[socket.socket]:
    """Listening socket whose connections the test serves."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(DEADLINE_S)
        yield server


def pose(x: float, y: float, z: float) -> list[list[float]]:
    """Rotation by 90 degrees about z and a translation in mm, exact in 32-bit floats."""
    return np.array(
        [[0.0, -1.0, 0.0, x], [1.0, 0.0, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]]
    ).tolist()
