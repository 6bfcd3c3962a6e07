"""The processes of the loop: physics and hand, the tracker's driver, guard and controller."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from app.files.shipped import shipped
from benchmarks.closed_loop.base_error import drawn_registration
from benchmarks.closed_loop.loop_operator import Operator
from benchmarks.harness.processes import CLI, Child, children

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
        return {name: child.cpu_s for name, child in self.children.items()}

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
    registration, by default the same. Without ``fixture`` the guard is that of `stand_ins`.
    ``base_error``: the base in the controller's file has an error (`base_error`).
    """
    folder.mkdir(parents=True, exist_ok=True)
    errors_seed = seed if tracker_seed is None else tracker_seed
    control, truth_file = write_control(folder, base_error, errors_seed), folder / "truth.npz"
    live = ("live", "--config", shipped(*WORLD, "live.yaml"), "--constraint-hz", 200)
    stand_in = ("-m", "benchmarks.closed_loop.stand_ins")
    physics = ("-m", "benchmarks.closed_loop.physics", seed, errors_seed, truth_file)
    with children(folder) as (running, start):
        start("tracker", *stand_in, "tracker")
        start("guard", *((*CLI, *live) if fixture else (*stand_in, "guard")))
        start("controller", *CLI, "control", control)
        for child in running.values():  # real time begins when the others have started
            child.first_output(START_S)
        start("physics", *physics).expect("ready", START_S)
        yield Loop(running, operator, truth_file)


def write_control(folder: Path, base_error: bool, seed: int) -> Path:
    """Write the shipped ``control.yaml``; with an error of the base if asked, drawn by ``seed``."""
    document = yaml.safe_load(shipped(*WORLD, "control.yaml").read_text())
    if base_error:
        document["base"]["pose"]["matrix"] = drawn_registration(seed).matrix.ravel().tolist()
    path = folder / "control.yaml"
    path.write_text(yaml.safe_dump(document))
    return path
