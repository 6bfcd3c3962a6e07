"""Time of a physics step of a world, beside MuJoCo's own step of the same model.

``marginguard bench simulation [WORLD]``: the scripted hand pushes, the arm follows slow joint
velocities, the tracker measures. Prints the CPU time of a step (p50, p99, maximum) and how much
faster than real time the world runs, then the same for a bare ``mj_step`` in the same minute. CPU
time is that of the thread, so that other programs do not count. With ``--minutes M`` the world then
runs that long in real time in a process of its own, and its pace is measured against the clock of
the host. Exit status 1 if the p99 is above the goal, if the world drifts by more than 1 ms, or if
more than 10 ms of the time were not simulated.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.files.extras import check_installed
from app.files.shipped import shipped
from app.geometry import MarginGuardError

if TYPE_CHECKING:
    from benchmarks.simulation_pace import Pace

GOAL_MS = 0.5
MAX_DRIFT_MS, MAX_MISSING_S = 1.0, 0.01
WARM_UP = 200


def measured(step: Callable[[int], object], count: int) -> dict[str, float]:
    """CPU time of ``count`` steps in ms, and simulated steps per second of wall time."""
    for number in range(WARM_UP):
        step(number)
    times = np.zeros(count)
    started = time.perf_counter()
    for number in range(count):
        before = time.thread_time_ns()
        step(WARM_UP + number)
        times[number] = 1e-6 * (time.thread_time_ns() - before)
    wall_s = time.perf_counter() - started
    p50, p99 = np.percentile(times, (50, 99)).tolist()
    return {
        "p50_ms": p50,
        "p99_ms": p99,
        "max_ms": float(times.max()),
        "steps_per_s": count / wall_s,
    }


def run_world(path: Path, count: int) -> dict[str, object]:
    """Measure the world at ``path`` and a bare ``mj_step`` of its model."""
    import mujoco

    from app.simulation import (
        JointVelocityCommand,
        ScriptedHand,
        World,
        WorldTracker,
        open_world,
    )

    description = open_world(path)
    world = World(description)
    hand, tracker = None, None
    if description.hand is not None:
        robot = next(each for each in description.robots if each.name == description.hand.robot)
        if robot.tool is not None:
            hand = ScriptedHand(description.hand, robot.tool.name)
    if description.tracker is not None:
        tracker = WorldTracker(description.tracker, description.seed)
    contacts = 0

    def step(number: int) -> None:
        nonlocal contacts
        state = world.state()
        speed = 0.2 * float(np.sin(0.002 * number))
        commands = {
            name: JointVelocityCommand(state.time_ns, arm.joints, (speed,) * len(arm.joints))
            for name, arm in state.arms.items()
        }
        state = world.step(commands, {} if hand is None else {hand.tool: hand.wrench(state)})
        if tracker is not None:
            tracker.observe(state)
            tracker.arrived(state.time_ns)
        contacts += len(world.data.contact) > 0

    ours = measured(step, count)
    model, data = world.model, mujoco.MjData(world.model)
    bare = measured(lambda _: mujoco.mj_step(model, data), count)
    return {
        "world": description.name,
        "steps": count,
        "timestep_ms": 1e-6 * description.timestep_ns,
        "degrees_of_freedom": int(model.nv),
        "convex_parts": int(model.ngeom),
        "steps_with_contact": contacts,
        "world_step": ours,
        "mj_step": bare,
        "real_time_factor": ours["steps_per_s"] * 1e-9 * description.timestep_ns,
        "goal_p99_ms": GOAL_MS,
        "load": os.getloadavg()[0],
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; return its exit status."""
    parser = argparse.ArgumentParser(
        prog="marginguard bench simulation",
        description=__doc__.split("\n\n")[0] if __doc__ else None,
    )
    parser.add_argument(
        "world",
        nargs="?",
        type=Path,
        default=shipped("data", "worlds", "lumpectomy"),
        help="world file or its folder (default: the shipped one)",
    )
    parser.add_argument("--steps", type=int, default=10_000, help="steps to measure")
    parser.add_argument(
        "--minutes", type=float, metavar="M", help="also measure the pace over that time"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(arguments)
    if options.steps < 1:
        parser.error(f"--steps is {options.steps}; expected at least 1")
    if options.minutes is not None and not 0.1 <= options.minutes <= 600.0:
        parser.error(f"--minutes is {options.minutes:g}; expected 0.1 to 600")
    try:
        check_installed("mujoco", "coacd")
        found = run_world(options.world, options.steps)
        pace = None if options.minutes is None else _pace(options.world, options.minutes)
    except MarginGuardError as error:
        print(f"marginguard bench simulation: {error}", file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps({**found, "pace": pace and asdict(pace)}, indent=2))
    else:
        _print(found)
        if pace is not None:
            print(
                f"  {pace.seconds:.0f} s in real time: drift {pace.drift_ms:.3f} ms, delay behind "
                f"the stamp p50 {pace.median_ms:.2f} ms  p99 {pace.p99_ms:.2f} ms  "
                f"max {pace.max_ms:.1f} ms, not simulated {pace.missing_s:.4f} s"
            )
    is_fast = found["world_step"]["p99_ms"] <= GOAL_MS  # type: ignore[index]
    keeps_pace = pace is None or (
        abs(pace.drift_ms) <= MAX_DRIFT_MS and pace.missing_s <= MAX_MISSING_S
    )
    return 0 if is_fast and keeps_pace else 1


def _pace(world: Path, minutes: float) -> "Pace":
    from benchmarks.simulation_pace import measured_pace

    check_installed("rclpy")
    return measured_pace(world, minutes)


def _print(found: dict[str, object]) -> None:
    print(
        f"world {found['world']}: {found['degrees_of_freedom']} degrees of freedom, "
        f"{found['convex_parts']} convex parts, {found['steps']} steps of "
        f"{found['timestep_ms']:g} ms, load {found['load']:.1f}"
    )
    for name in ("world_step", "mj_step"):
        figures = found[name]
        assert isinstance(figures, dict)
        print(
            f"  {name:10s}  CPU p50 {figures['p50_ms']:.3f} ms  p99 {figures['p99_ms']:.3f} ms  "
            f"max {figures['max_ms']:.3f} ms  {figures['steps_per_s']:.0f} steps/s"
        )
    print(f"  real time factor {found['real_time_factor']:.1f}; goal: p99 <= {GOAL_MS} ms")


if __name__ == "__main__":
    sys.exit(main())
