"""The processes of the loop: physics and hand, the tracker's driver, guard and controller."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from app.files.shipped import shipped
from benchmarks.closed_loop.base_error import drawn_registration
from benchmarks.closed_loop.loop_operator import Operator
from benchmarks.harness.processes import Child, ChildError

START_S = 300.0
"""A guard that compiles its kernels takes minutes to start."""

POLL_S = 0.3
"""Time between two looks of the operator."""

WORLD = ("data", "worlds", "lumpectomy")


@dataclass(slots=True)
class Loop:
    """Running processes by name (physics, tracker, guard, controller), and their operator."""

    children: dict[str, Child]
    operator: Operator
    truth_file: Path

    def send(self, **command: Any) -> None:
        """Send a command to the physics."""
        self.children["physics"].send(**command)

    def expect(self, event: str, timeout_s: float = 60.0) -> dict[str, Any]:
        """Wait for an event of the physics; raises `ChildError`."""
        return self.children["physics"].expect(event, timeout_s)

    def next_event(self) -> dict[str, Any] | None:
        """The next event of the physics; None if there is none for `POLL_S`."""
        return self.children["physics"].poll(POLL_S)

    def cpu_s(self) -> dict[str, float]:
        """Processor time of each process since its start, in s; 0 for one that has ended."""
        return {name: _cpu_s(child.process.pid) for name, child in self.children.items()}

    def follows(self, timeout_s: float = START_S) -> bool:
        """Wait until the arm follows the hand."""
        state = self.operator.state
        return self.operator.until(lambda: state("control /arm") == "follows", timeout_s)


@contextmanager
def running_loop(
    folder: Path,
    operator: Operator,
    *,
    seed: int,
    fixture: bool,
    base_error: bool = False,
    tracker_seed: int | None = None,
) -> Iterator[Loop]:
    """Start all processes, the physics last; end them on exit. Logs and truth are in ``folder``.

    ``seed`` gives the directions of the pushes, ``tracker_seed`` the errors of tracker and
    registration, by default the same. Without ``fixture`` the guard is `open_guard`.
    ``base_error``: the base in the controller's file has an error (`base_error`).
    """
    folder.mkdir(parents=True, exist_ok=True)
    errors_seed = seed if tracker_seed is None else tracker_seed
    control, truth_file = write_control(folder, base_error, errors_seed), folder / "truth.npz"
    live = str(shipped(*WORLD, "live.yaml"))
    cli = ["-m", "app.cli"]
    guard = [*cli, "live", "--config", live, "--constraint-hz", "200"]
    programs = {
        "tracker": ["-m", "benchmarks.closed_loop.tracker_relay"],
        "guard": guard if fixture else ["-m", "benchmarks.closed_loop.open_guard"],
        "controller": [*cli, "control", str(control)],
        "physics": [
            "-m",
            "benchmarks.closed_loop.physics",
            str(seed),
            str(errors_seed),
            str(truth_file),
        ],
    }
    children: dict[str, Child] = {}
    try:
        for name, arguments in programs.items():
            if name == "physics":  # real time begins when the others have started
                for other in children.values():
                    _wait_for_output(other)
            children[name] = Child(name, arguments, folder / f"{name}.log")
        loop = Loop(children, operator, truth_file)
        loop.expect("ready", START_S)
        yield loop
    finally:
        for child in children.values():
            child.end()


def write_control(folder: Path, base_error: bool, seed: int) -> Path:
    """Write the shipped ``control.yaml``; with an error of the base if asked, drawn by ``seed``."""
    document = yaml.safe_load(shipped(*WORLD, "control.yaml").read_text())
    if base_error:
        document["base"]["pose"]["matrix"] = drawn_registration(seed).matrix.ravel().tolist()
    path = folder / "control.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def _cpu_s(pid: int) -> float:
    """User and system time of a process in s (proc(5)); 0 if it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _wait_for_output(child: Child) -> None:
    """Wait for the first line of a program: an event, or another line of a command."""
    end_s = time.monotonic() + START_S
    while child.running and time.monotonic() < end_s:
        if child.has_output:
            return
        time.sleep(0.05)
    raise ChildError(f"{child.name} has not started: {child.tail()}")


def read_truth(path: Path) -> dict[str, Any]:
    """The truth that the physics has written: ``stamps`` (n, 3), ``poses`` (n, 24)."""
    with np.load(path) as found:
        return {name: found[name] for name in found.files}
