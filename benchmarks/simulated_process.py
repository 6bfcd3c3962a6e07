"""``marginguard simulate`` as a process of its own, for benchmarks."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from app.geometry import MarginGuardError

START_TIMEOUT_S = 60.0


@contextmanager
def running_simulation(world: Path) -> Iterator[subprocess.Popen[str]]:
    """Run ``world`` within the context, from when it has begun.

    Raises `MarginGuardError` if it has not begun after `START_TIMEOUT_S`.
    """
    command = [sys.executable, "-m", "app.cli", "simulate", str(world)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            deadline = threading.Timer(START_TIMEOUT_S, process.kill)
            deadline.start()
            assert process.stdout is not None
            began = any(line.startswith("SIMULATION") for line in process.stdout)
            deadline.cancel()
            if not began:
                raise MarginGuardError("simulation: it has ended; expected it to run")
            yield process
        finally:
            process.terminate()
