"""One wait for all tests of the Slicer modules."""

import time
from collections.abc import Callable
from typing import Any

import pytest

DEADLINE_S = 120.0
"""Ends a hang; a first run compiles for a minute."""
TICK_S = 0.005


def wait_until(
    ready: Callable[[], Any],
    meanwhile: Callable[[], Any] = lambda: None,
    state: Callable[[], str] = lambda: "",
) -> None:
    """Call ``meanwhile()`` repeatedly, like the module's timer, until ``ready()``."""
    end_s = time.monotonic() + DEADLINE_S
    while not ready():
        if time.monotonic() > end_s:
            pytest.fail(f"not within {DEADLINE_S:g} s: {state()}")
        time.sleep(TICK_S)
        meanwhile()
