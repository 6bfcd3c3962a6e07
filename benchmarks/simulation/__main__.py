"""Time of a physics step of a world, beside MuJoCo's own step of the same model.

``marginguard bench simulation [WORLD]``: the scripted hand pushes, the arm follows slow joint
velocities, the tracker measures. Prints the CPU time of a step (p50, p99, maximum) and how much
faster than real time the world runs, then the same for a bare ``mj_step`` in the same minute. CPU
time is that of the thread, so that other programs do not count. With ``--minutes M`` 'marginguard
simulate' then runs the world that long in real time in a process of its own, and the poses that it
publishes every 5 ms give its pace against the clock of the host.
"""

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from app.files.extras import check_installed
from app.files.paths import shipped
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, MarginGuardError
from benchmarks.harness.figures import figures_table, percentiles, show, spread
from benchmarks.harness.goals import at_most, finish
from benchmarks.harness.options import BenchParser
from benchmarks.harness.processes import CLI, ChildError, children
from benchmarks.ros_domain import own_ros

GOAL_MS = 0.5
MAX_DRIFT_MS, MAX_MISSING_S = 1.0, 0.01
WARM_UP = 200
ENDS = 2000  # messages at each end whose median delays are compared: 10 s


def pace_of(stamps_ns: FloatArray, arrivals_ns: FloatArray, period_ns: int) -> dict[str, float]:
    """Delay of messages (n,) behind their stamps, and what of the time was not simulated.

    ``drift_ms``: by how much the median delay of the last `ENDS` messages is larger than that of
    the first ones. ``missing_s``: time between the stamps that no message stands for: lags that the
    physics has dropped, and lost messages. Raises `MarginGuardError` for fewer than two messages.
    """
    if len(stamps_ns) < 2:
        raise MarginGuardError(f"simulation: {len(stamps_ns)} poses; expected at least 2")
    delays_ms = (arrivals_ns - stamps_ns) / NS_PER_MS
    ends = min(ENDS, len(delays_ms) // 2)
    median, p99, longest = percentiles(delays_ms, 50, 99, 100)
    span_ns = int(stamps_ns[-1] - stamps_ns[0])
    return {
        "seconds": span_ns / NS_PER_S, "median_ms": median, "p99_ms": p99, "max_ms": longest,
        "drift_ms": float(np.median(delays_ms[-ends:]) - np.median(delays_ms[:ends])),
        "missing_s": (span_ns - (len(stamps_ns) - 1) * period_ns) / NS_PER_S,
    }  # fmt: skip


def measured_pace(world: Path, minutes: float) -> dict[str, float]:
    """Run ``world`` for that long, and measure its pace. Raises `MarginGuardError`."""
    stamps: list[int] = []
    arrivals: list[int] = []
    try:
        with own_ros() as folder, children(folder) as (_, start):
            simulation = start("simulation", *CLI, "simulate", world)
            simulation.line("SIMULATION", 300.0)
            # Load ROS only now: it reads the variables when it is loaded.
            from app.bridge import RosNode, topics
            from app.bridge.simulation.simulation_node import STATE_PERIOD_NS
            from app.bridge.tf_poses import TfMessageReader
            from app.bridge.world_client import TRUTH

            read = TfMessageReader()

            def take(data: bytes) -> None:
                now_ns = time.time_ns()
                samples = read(data)
                if samples and samples[0].child.startswith(TRUTH):
                    stamps.append(samples[0].stamp_ns)
                    arrivals.append(now_ns)

            with RosNode("pace") as ros:
                ros.subscribe(topics.TF, take, raw=True)
                end_s = time.monotonic() + 60.0 * minutes
                while (left_s := end_s - time.monotonic()) > 0.0:
                    simulation.poll(min(left_s, 1.0))
    except ChildError as error:
        raise MarginGuardError(f"{error}; expected it to run") from error
    return pace_of(np.array(stamps), np.array(arrivals), STATE_PERIOD_NS)


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
    return {**spread(times), "steps_per_s": count / wall_s}


def run_world(path: Path, count: int) -> dict[str, Any]:
    """Measure the world at ``path`` and a bare ``mj_step`` of its model."""
    import mujoco

    from app.simulation import JointVelocityCommand, ScriptedHand, World, WorldTracker, open_world

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
    }


def main(arguments: Sequence[str] | None = None) -> int:
    parser = BenchParser("simulation", __doc__)
    world, text = shipped("data", "worlds", "lumpectomy"), "world file or folder (default: shipped)"
    parser.add_argument("world", nargs="?", type=Path, default=world, help=text)
    parser.number("--steps", 10_000, "steps to measure")
    text = "also measure the pace over that time"
    parser.number("--minutes", None, text, low=0.1, high=600.0, metavar="M")
    options = parser.parse_args(arguments)
    pace = None
    try:
        check_installed("mujoco", "coacd")
        found = run_world(options.world, options.steps)
        if options.minutes is not None:
            check_installed("rclpy")
            pace = measured_pace(options.world, options.minutes)
    except MarginGuardError as error:
        print(f"marginguard bench simulation: {error}", file=sys.stderr)
        return 2
    goals = [at_most("p99 of a step is", found["world_step"]["p99_ms"], GOAL_MS, "ms", ".3f")]
    if pace is not None:
        goals.append(at_most("it drifts by", abs(pace["drift_ms"]), MAX_DRIFT_MS, "ms", ".3f"))
        goals.append(at_most("not simulated are", pace["missing_s"], MAX_MISSING_S, "s", ".4f"))
    found["pace"] = pace
    show(figures_table(found))
    return finish(options.json, found, goals)
