"""One ROS domain per test, so that tests that run in parallel do not receive each other's data."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchmarks import ros_domain


@contextmanager
def reserved_domain() -> Iterator[int]:
    """Reserve a ROS domain that no other test on this machine uses, with an empty state folder."""
    with ros_domain.reserved_domain() as domain:
        shutil.rmtree(_state_home(domain), ignore_errors=True)
        yield domain


def _state_home(domain: int) -> Path:
    return Path(tempfile.gettempdir()) / f"marginguard-state-{os.getuid()}-{domain}"


def environment_of(domain: int) -> dict[str, str]:
    """Environment variables that restrict a process to the domain and to this machine.

    A hold that a test leaves behind is kept in the folder of its domain, not in the user's, and is
    gone when another test reserves the domain.
    """
    from app.bridge import prepare_environment  # loads ROS

    environment = {"ROS_DOMAIN_ID": str(domain), "XDG_STATE_HOME": str(_state_home(domain))}
    prepare_environment(environment)
    return environment


@contextmanager
def domain_in_environment() -> Iterator[int]:
    """Reserve a domain, and set it in the environment."""
    with reserved_domain() as domain, pytest.MonkeyPatch.context() as patch:
        for name, value in environment_of(domain).items():
            patch.setenv(name, value)
        yield domain


@pytest.fixture
def domain_id() -> Iterator[int]:
    """ROS domain that is reserved for one test; set in the environment."""
    with domain_in_environment() as domain:
        yield domain
