"""A pyigtl server in another process, and a plain socket for invalid data."""

import json
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bridge.conftest import start_receiver as start_receiver
from tests.ros_domain import domain_id as domain_id

PEER = Path(__file__).resolve().parents[1] / "oracles" / "pyigtl_peer.py"
DEADLINE_S = 60.0


class PyigtlServer:
    """pyigtl server in another process; ``send`` makes it send a message."""

    def __init__(self, port: int = 0) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(PEER), str(port)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self._deadline = threading.Timer(DEADLINE_S, self._process.kill)
        self._deadline.start()
        assert self._process.stdout is not None
        found = re.match(r"port (\d+)", self._process.stdout.readline())
        assert found is not None, "the pyigtl server did not start"
        self.port = int(found[1])

    def send(self, **message: Any) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(message) + "\n")
        self._process.stdin.flush()

    def kill(self) -> None:
        self._deadline.cancel()
        self._process.kill()
        self._process.communicate()


@pytest.fixture
def start_pyigtl() -> Iterator[Callable[..., PyigtlServer]]:
    """``start_pyigtl(port=0)`` starts a server, which is killed after the test."""
    started: list[PyigtlServer] = []

    def start(port: int = 0) -> PyigtlServer:
        started.append(PyigtlServer(port))
        return started[-1]

    yield start
    for server in started:
        server.kill()


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
