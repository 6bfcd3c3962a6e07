"""A ROS domain of its own for each test, so that tests run side by side do not hear each other."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

HIGHEST = 100
"""Ports of domains above 101 lie in Linux's ephemeral range."""


@contextmanager
def held_domain() -> Iterator[int]:
    """Hold a ROS domain that no other test of this machine uses now.

    Processes agree by locked files, which a process that dies gives back.
    """
    for offset in range(HIGHEST):
        domain = 1 + (os.getpid() + offset) % HIGHEST
        path = Path(tempfile.gettempdir()) / f"marginguard-ros-domain-{domain}.lock"
        with path.open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    pytest.fail(f"all ROS domains from 1 to {HIGHEST} are in use by other tests")


def environment_of(domain: int) -> dict[str, str]:
    """What keeps a process in the domain, and on this machine, as our commands are."""
    from app.bridge import prepare_environment  # ROS, which not every test needs

    environment = {"ROS_DOMAIN_ID": str(domain)}
    prepare_environment(environment)
    return environment


@pytest.fixture
def domain_id(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A domain for one test."""
    with held_domain() as domain:
        for name, value in environment_of(domain).items():
            monkeypatch.setenv(name, value)
        yield domain
