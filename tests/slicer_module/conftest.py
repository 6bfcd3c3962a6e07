"""The ROS2 module in a scene, and a peer process with plain rclpy."""

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.ros_domain import environment_of, reserved_domain

PEER = Path(__file__).resolve().parent / "ros2_peer.py"
DEADLINE_S = 30.0
"""Timeout of a reply of the peer process, which takes less than a second."""
WAIT_S = 60.0
TICK_S = 0.005


class Peer:
    """Peer process; ``peer("publish", topic=..., ...)`` runs a command and returns its result."""

    def __init__(self, domain: int, log: Path) -> None:
        self._log = log
        with log.open("w") as errors:
            self._process = subprocess.Popen(
                [sys.executable, str(PEER)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                env={**os.environ, **environment_of(domain)},
            )

    def __call__(self, do: str, **arguments: Any) -> Any:
        self.send(do, **arguments)
        return self.result()

    def send(self, do: str, **arguments: Any) -> None:
        """Send the command ``do`` without waiting for its result."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"do": do, **arguments}) + "\n")
        self._process.stdin.flush()

    def result(self) -> Any:
        """Wait for the result of the last command; fail the test if the command failed."""
        assert self._process.stdout is not None
        deadline = threading.Timer(DEADLINE_S, self._process.kill)
        deadline.start()
        line = self._process.stdout.readline()
        deadline.cancel()
        reply = json.loads(line) if line else {"failed": self._log.read_text()}
        if "failed" in reply:
            pytest.fail(f"the peer process: {reply['failed']}")
        return reply["done"]

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()


@pytest.fixture(scope="session")
def ros_domain() -> Iterator[int]:
    with reserved_domain() as domain:
        yield domain


@pytest.fixture(scope="session")
def peer(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Peer]:
    process = Peer(ros_domain, tmp_path_factory.mktemp("peer") / "peer.log")
    yield process
    process.close()


@pytest.fixture(scope="session")
def session_logic() -> Iterator[Any]:
    from slicer import vtkMRMLScene

    from app.scene import SceneApplication
    from ROS2Lib.logic import Ros2Api

    application = SceneApplication(vtkMRMLScene())
    made = Ros2Api(application.scene)
    yield made
    made.Close()


MEMBERS = (
    "robot",
    "publisher",
    "subscriber",
    "service_client",
    "parameter",
    "broadcaster",
    "lookup",
)
"""Roles of the members of a ROS2 node."""


@pytest.fixture
def logic(session_logic: Any, ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Logic of the module; its nodes are in the ROS domain of `peer`. Members do not stay."""
    for name, value in environment_of(ros_domain).items():
        monkeypatch.setenv(name, value)
    yield session_logic
    node = session_logic.GetDefaultROS2Node()
    members = [
        node.GetNthNodeReference(role, index)
        for role in MEMBERS
        for index in range(node.GetNumberOfNodeReferences(role))
    ]
    for member in members:
        if member.GetScene() is not None:
            session_logic.scene.RemoveNode(member)


@pytest.fixture
def node(logic: Any) -> Any:
    return logic.GetDefaultROS2Node()


def wait_until(ready: Callable[[], Any], meanwhile: Callable[[], Any] = lambda: None) -> None:
    """Call ``meanwhile()`` repeatedly, like the module's timer, until ``ready()``."""
    pause = threading.Event()
    for _ in range(int(WAIT_S / TICK_S)):
        meanwhile()
        if ready():
            return
        pause.wait(TICK_S)
    pytest.fail(f"not within {WAIT_S:g} s")


@pytest.fixture
def spin_until(logic: Any) -> Callable[[Callable[[], Any]], None]:
    """Spin until ``ready()``."""
    return lambda ready: wait_until(ready, logic.Spin)


@pytest.fixture(name="wait_until")
def wait_without_spinning() -> Callable[..., None]:
    return wait_until
