"""A ROS domain of its own for each test, so that tests run side by side do not hear each other."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

HIGHEST = 100
"""Ports of domains above 101 lie in Linux's ephemeral range."""


@pytest.fixture
def domain_id(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS domain that no other test of this machine uses now, kept on this machine.

    Processes agree by locked files, which a process that dies gives back.
    """
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    for offset in range(HIGHEST):
        domain = 1 + (os.getpid() + offset) % HIGHEST
        path = Path(tempfile.gettempdir()) / f"marginguard-ros-domain-{domain}.lock"
        with path.open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
            yield domain
            return
    pytest.fail(f"all ROS domains from 1 to {HIGHEST} are in use by other tests")
