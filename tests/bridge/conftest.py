"""ROS for tests: a domain for each test, on this machine only, and other processes to talk to.

Pure helpers and fixtures; nothing here imports ROS, so that tests without ROS stay without it.
"""

import fcntl
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).resolve().parent
RECEIVER = HERE / "receiver.py"
DEADLINE_S = 90.0
"""After this a test has failed; nothing here takes more than a few seconds."""


@pytest.fixture
def domain_id(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS domain that no other test of this machine uses now, kept on this machine."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    # Ports of domains above 101 lie in Linux's ephemeral range.
    start = os.getpid() % 100
    for offset in range(100):
        domain = 1 + (start + offset) % 100
        path = Path(tempfile.gettempdir()) / f"marginguard-ros-domain-{domain}.lock"
        with path.open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
            yield domain
            return
    pytest.fail("all ROS domains from 1 to 100 are in use by other tests")


class Receiver:
    """A process of its own that prints each message it gets as a line of JSON."""

    def __init__(self, script: Path, arguments: list[str], environment: dict[str, str]) -> None:
        self._error = tempfile.TemporaryFile("w+")
        self._process = subprocess.Popen(
            [sys.executable, str(script), *arguments],
            stdout=subprocess.PIPE,
            stderr=self._error,
            text=True,
            env={**os.environ, **environment},
        )
        # Ends a read that would wait for ever.
        self._deadline = threading.Timer(DEADLINE_S, self._process.kill)
        self._deadline.start()
        self._early: list[str] = []

    def wait_until_ready(self) -> None:
        """Return when the other process has found a publisher for each of its topics."""
        for line in self._lines():
            if line.strip() == "ready":
                return
            self._early.append(line)  # latched, from before the others were found
        pytest.fail(f"the receiving process found no publisher: {self._said()}")

    def messages(self) -> list[dict[str, Any]]:
        """Everything it received; it ends by itself once it has what it was told to wait for."""
        lines = [*self._early, *(line for line in self._lines() if line.strip() != "ready")]
        if self._process.wait() != 0:
            pytest.fail(f"the receiving process did not get everything: {self._said()}")
        return [json.loads(line) for line in lines]

    def close(self) -> None:
        self._deadline.cancel()
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()
        self._error.close()

    def _lines(self) -> Iterator[str]:
        assert self._process.stdout is not None
        return iter(self._process.stdout.readline, "")

    def _said(self) -> str:
        self._process.kill()
        self._error.seek(0)
        return f"status {self._process.wait()}, {self._error.read()!r}"


StartReceiver = Callable[..., Receiver]


@pytest.fixture
def start_receiver(domain_id: int) -> Iterator[StartReceiver]:
    """``start_receiver("/tf", "tf2_msgs/msg/TFMessage", ...)``; killed at the end if need be."""
    started: list[Receiver] = []

    def start(
        *arguments: str,
        script: Path = RECEIVER,
        environment: dict[str, str] | None = None,
        wait: bool = True,
    ) -> Receiver:
        receiver = Receiver(script, list(arguments), environment or {})
        started.append(receiver)
        if wait:
            receiver.wait_until_ready()
        return receiver

    yield start
    for receiver in started:
        receiver.close()


CYCLONE = HERE / "cyclone_listener.py"
CYCLONE_ON_THIS_MACHINE = {
    "CYCLONEDDS_URI": (
        "<CycloneDDS><Domain><General>"
        "<Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces>"
        "<AllowMulticast>false</AllowMulticast>"
        "</General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
        "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
        "<Peers><Peer address='localhost'/></Peers>"
        "</Discovery></Domain></CycloneDDS>"
    )
}


@pytest.fixture
def start_cyclone(start_receiver: StartReceiver) -> StartReceiver:
    """``start_cyclone("virtual_fixture", "10")``: a listener on ``/tf`` without ROS."""

    def start(*arguments: str, wait: bool = True) -> Receiver:
        return start_receiver(
            *arguments, script=CYCLONE, environment=CYCLONE_ON_THIS_MACHINE, wait=wait
        )

    return start
