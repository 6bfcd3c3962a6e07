"""Wait for what has no event: a state that is computed on request, a file, a graph."""

import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

DEADLINE_S = 120.0
"""Ends a hang; no test depends on how long a wait takes. A first run compiles for a minute."""


def wait_until(
    condition: Callable[[], Any],
    meanwhile: Callable[[], object] = lambda: None,
    *,
    pause_s: float = 0.01,
    describe: Callable[[], object] = lambda: "the condition does not hold",
) -> Any:
    """Call ``meanwhile()`` again and again until ``condition()`` is true; return its value."""
    pause, end_s = threading.Event(), time.monotonic() + DEADLINE_S
    while not (found := condition()):
        if time.monotonic() > end_s:
            pytest.fail(f"not within {DEADLINE_S:g} s: {describe()}")
        meanwhile()
        pause.wait(pause_s)
    return found
