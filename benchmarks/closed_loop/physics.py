"""Process of the physics: ``python -m benchmarks.closed_loop.physics SEED FILE``.

Reads lines of JSON: ``{"do": "push", "number": 3}`` begins a push from the direction of that
number, for ``push_s`` if that is given; ``{"do": "end"}`` ends the process. Prints
events as lines of JSON: ``ready``; ``mid`` where the tool approaches fast; ``pushed`` at the end of
a push. At the end it writes the truth of every physics step to FILE (.npz).
"""

import json
import sys
import threading
import time
from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.bridge import RosNode, prepare_environment
from app.bridge.simulation import NODE_NAME, RealTime, SimulationNode
from app.cli.process import prompt_process
from app.files.paths import shipped
from app.geometry import NS_PER_S, FloatArray
from app.robot import Robot
from app.simulation import World, WorldState, open_world
from benchmarks.closed_loop.hand import PUSH_S, Phase, PushingHand
from benchmarks.closed_loop.stand_ins import RAW_TOPIC
from benchmarks.harness.peer import emit

MIN_EFFORT_N_M = 5.0
MID_MM, MID_MM_S = 28.0, 40.0  # distance and speed of a tool in the middle of its approach


class TruthShell:
    """The `Shell` of the simulation, which also records the truth of every step."""

    def __init__(self, node: SimulationNode, hand: PushingHand, tumor: str) -> None:
        self._node, self._hand, self._tumor = node, hand, tumor
        self._pushes: deque[tuple[int, float]] = deque()
        self._poses: list[tuple[float, ...]] = []
        self._stamps: list[tuple[int, int, int]] = []
        self._last_phase, self._is_mid = Phase.REST, False
        self._before: tuple[int, FloatArray] | None = None
        self._first_row = 0
        self.lags = 0

    def push(self, number: int, push_s: float) -> None:
        """Begin the push ``number`` of ``push_s`` before the next step. Thread-safe."""
        self._pushes.append((number, push_s))

    def step(self, world: World, now_ns: int) -> WorldState:
        while self._pushes:
            self._hand.begin(world.time_ns, *self._pushes.popleft())
            self._is_mid, self._first_row = False, len(self._stamps)
        return self._node.step(world, now_ns)

    def publish(self, state: WorldState, stamp_ns: int) -> None:
        """Publish and record ``state``; print the events of the push."""
        self._node.publish(state, stamp_ns)
        tool, tumor = state.bodies[self._hand.tool], state.bodies[self._tumor]
        (arm,) = state.arms.values()
        pose = (*tool.translation_mm, *tool.rotation.ravel(), *tumor.translation_mm,
                *tumor.rotation.ravel())  # fmt: skip
        self._poses.append(pose)
        phase = self._hand.phase
        self._stamps.append((stamp_ns, int(phase), int(arm.is_busy)))
        before, self._before = self._before, (stamp_ns, tool.translation_mm)
        away_mm = float(np.linalg.norm(tool.translation_mm - tumor.translation_mm))
        if phase is Phase.PUSH and not self._is_mid and away_mm < MID_MM and before is not None:
            moved = float(np.linalg.norm(tool.translation_mm - before[1]))
            if moved * NS_PER_S > MID_MM_S * (stamp_ns - before[0]):
                self._is_mid = True
                emit("mid", stamp_ns=stamp_ns)
        if phase is Phase.REST and self._last_phase is not Phase.REST:
            rows = (self._first_row, len(self._stamps))
            emit("pushed", reached=self._hand.reached, rows=rows, lags=self.lags)
        self._last_phase = phase

    def idle(self) -> None:
        self._node.idle()

    def report(self, real_time_factor: float, lags: int) -> None:
        self.lags = lags
        self._node.report(real_time_factor, lags)

    def write(self, path: Path) -> None:
        """Write the truth: ``stamps`` (n, 3) and ``poses`` (n, 24)."""
        stamps = np.array(self._stamps, dtype=np.int64).reshape(-1, 3)
        np.savez(path, stamps=stamps, poses=np.array(self._poses).reshape(-1, 24))


def with_strong_drives(robot: Robot) -> Robot:
    """``robot`` with drives of at least `MIN_EFFORT_N_M`.

    The hand's 10 N at the tip turn the wrist of the shipped arm, which holds 1 N m, whatever is
    commanded.
    """
    joints = tuple(
        replace(each, dynamics=replace(each.dynamics, effort=max(effort, MIN_EFFORT_N_M)))
        if (effort := each.dynamics.effort) is not None
        else each
        for each in robot.joints
    )
    return Robot(robot.name, robot.links, joints)


def main() -> int:
    seed, file = int(sys.argv[1]), Path(sys.argv[2])
    prepare_environment()
    description = open_world(shipped("data", "worlds", "lumpectomy"))
    (robot,), (tumor,), hand = description.robots, description.tissues, description.hand
    assert robot.tool is not None and hand is not None
    description = replace(
        description,
        seed=seed,
        robots=(replace(robot, collision="none", robot=with_strong_drives(robot.robot)),),
        bodies=(),
        tissues=(replace(tumor, shifts=()),),
        breathing=replace(description.breathing, held_until_s=0.0),
    )
    world, stop = World(description), threading.Event()
    remap = ("--ros-args", "-r", f"/tracked_transforms:={RAW_TOPIC}")
    with RosNode(NODE_NAME, ros_args=remap) as ros:
        pushing = PushingHand(robot.tool.name, tumor.name, hand.force_n, seed)
        node = SimulationNode(ros, description, hand=pushing)
        shell = TruthShell(node, pushing, tumor.name)
        with prompt_process():  # as 'marginguard simulate'
            pace = RealTime(
                world, clock_ns=time.monotonic_ns, host_ns=time.time_ns, wait=time.sleep
            )
            node.serve(pace)
            threading.Thread(target=_read, args=(shell, stop), daemon=True).start()
            emit("ready")
            pace.run(shell, stop)
    shell.write(file)
    emit("written")
    return 0


def _read(shell: TruthShell, stop: threading.Event) -> None:
    for line in sys.stdin:
        command = json.loads(line)
        if command["do"] == "end":
            break
        shell.push(command["number"], command.get("push_s", PUSH_S))
    stop.set()


if __name__ == "__main__":
    sys.exit(main())
