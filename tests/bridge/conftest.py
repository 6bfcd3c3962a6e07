"""ROS for tests: a domain for each test, on this machine only, and other processes to talk to.

Pure helpers and fixtures; nothing here imports ROS, so that tests without ROS stay without it.
"""

import fcntl
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).resolve().parent
RECEIVER = HERE / "receiver.py"
DEADLINE_S = 60.0
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
        self._process = subprocess.Popen(
            [sys.executable, str(script), *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **environment},
        )

    def wait_until_ready(self) -> None:
        """Return when the other process has made all its subscriptions."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if line.strip() != "ready":
            pytest.fail(f"the receiving process said {line!r}: {self._end()[1]}")

    def messages(self) -> list[dict[str, Any]]:
        """Everything it received; it ends by itself once it has what it was told to wait for."""
        out, error = self._process.communicate(timeout=DEADLINE_S)
        if self._process.returncode != 0:
            pytest.fail(f"the receiving process failed ({self._process.returncode}): {error}")
        return [json.loads(line) for line in out.splitlines()]

    def close(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.communicate()

    def _end(self) -> tuple[str, str]:
        self._process.kill()
        return self._process.communicate()


StartReceiver = Callable[..., Receiver]


@pytest.fixture
def start_receiver(domain_id: int) -> Iterator[StartReceiver]:
    """``start_receiver("/tf", "tf2_msgs/msg/TFMessage", ...)``; killed at the end if need be."""
    started: list[Receiver] = []

    def start(
        *arguments: str, script: Path = RECEIVER, environment: dict[str, str] | None = None
    ) -> Receiver:
        receiver = Receiver(script, list(arguments), environment or {})
        started.append(receiver)
        receiver.wait_until_ready()
        return receiver

    yield start
    for receiver in started:
        receiver.close()
