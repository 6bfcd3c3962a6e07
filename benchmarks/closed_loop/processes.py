"""The processes of the loop: physics and hand, the tracker's driver, guard and controller."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from app.files.paths import shipped
from app.geometry import Transform
from app.registration import register_points
from benchmarks.closed_loop.loop_operator import Operator
from benchmarks.harness.processes import CLI, Child, children

START_S = 300.0  # a guard that compiles its kernels takes minutes to start
POLL_S = 0.3  # time between two looks of the operator
WORLD = ("data", "worlds", "lumpectomy")

SIGMA_MM = 1.0  # standard deviation of a touched landmark along each axis
LANDMARKS_MM = np.array(
    [[140, -60, 40], [140, 60, 40], [260, -60, 40], [260, 60, 40], [200, 0, 110], [170, 0, 20]],
    dtype=np.float64,
)
"""Around the tumour of the shipped world, in the base's frame."""

CHI2_95 = 12.59  # 95 % quantile of the chi-squared distribution with 6 degrees of freedom
_MAX_DRAWS = 1000


@dataclass(slots=True)
class Loop:
    """Running processes by name (physics, tracker, guard, controller), and their operator."""

    children: dict[str, Child]
    operator: Operator
    truth_file: Path

    @property
    def physics(self) -> Child:
        """The process that takes the commands."""
        return self.children["physics"]

    def next_event(self) -> dict[str, Any]:
        """Re-arm until the physics has an event; raises `ChildError`."""
        event = None
        while event is None:
            self.operator.rearm()
            event = self.physics.poll(POLL_S)
        return event

    def end(self) -> None:
        """End the physics, which then writes the truth."""
        self.physics.send(do="end")
        self.physics.expect("written", 60.0)

    def cpu_s(self) -> dict[str, float]:
        """Processor time of each process since its start, in s; 0 for one that has ended."""
        return {name: child.cpu_s for name, child in self.children.items()}

    def follows(self, timeout_s: float = START_S) -> bool:
        state = self.operator.state
        return self.operator.until(lambda: state("control /arm") == "follows", timeout_s)


@contextmanager
def running_loop(
    folder: Path, operator: Operator, seed: int, *, fixture: bool, base_error: bool = False
) -> Iterator[Loop]:
    """Start all processes, the physics last; end them on exit. Logs and truth are in ``folder``.

    ``seed`` gives the directions of the pushes and the errors of tracker and registration. Without
    ``fixture`` the guard is that of `stand_ins`. ``base_error``: the base in the controller's file
    has an error (`drawn_registration`).
    """
    folder.mkdir(parents=True, exist_ok=True)
    control, truth_file = folder / "control.yaml", folder / "truth.npz"
    document = yaml.safe_load(shipped(*WORLD, "control.yaml").read_text())
    if base_error:
        document["base"]["pose"]["matrix"] = drawn_registration(seed).matrix.ravel().tolist()
    control.write_text(yaml.safe_dump(document))
    live = ("live", "--config", shipped(*WORLD, "live.yaml"), "--constraint-hz", 200)
    stand_in = ("-m", "benchmarks.closed_loop.stand_ins")
    physics = ("-m", "benchmarks.closed_loop.physics", seed, truth_file)
    with children(folder) as (running, start):
        start("tracker", *stand_in, "tracker")
        start("guard", *((*CLI, *live) if fixture else (*stand_in, "guard")))
        start("controller", *CLI, "control", control)
        for child in running.values():  # real time begins when the others have started
            child.first_output(START_S)
        start("physics", *physics).expect("ready", START_S)
        yield Loop(running, operator, truth_file)


def drawn_registration(seed: int) -> Transform:
    """``tracker_from_base`` of a base at the tracker's origin, from noisy landmarks.

    The registration's error is inside the 95 % ellipsoid of its predicted covariance; a draw
    outside it is drawn again.
    """
    random = np.random.default_rng([seed, 7])
    for _ in range(_MAX_DRAWS):
        measured = LANDMARKS_MM + random.normal(scale=SIGMA_MM, size=LANDMARKS_MM.shape)
        frames = {"fixed_frame": "tracker", "moving_frame": "base"}
        covariances = SIGMA_MM**2 * np.eye(3)
        found = register_points(measured, LANDMARKS_MM, covariances_mm2=covariances, **frames)
        assert found.covariance is not None
        error = found.transform.inverse()
        motion = np.concatenate([error.rotation_vector, error.translation_mm])
        if float(motion @ np.linalg.solve(found.covariance, motion)) <= CHI2_95:
            return found.transform
    raise AssertionError("95 of 100 draws are expected inside the ellipsoid")
