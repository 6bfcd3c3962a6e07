"""Round trip of edits: from a scene to the physics and back into the scene.

``marginguard bench edits``: 'marginguard simulate' in a process of its own simulates a world with
26 bodies in real time. The scene here moves all of them 200 times per second: each edit changes 26
transform nodes, is sent as one request, is applied by the physics, and comes back on /tf with the
other poses. The delay is from the first changed node until the scene has all 26 poses of that edit,
or of a later one, back. Exit status 1 if fewer than 90 % of the edits come back.
"""

import argparse
import json
import os
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from benchmarks.simulated_process import START_TIMEOUT_S, running_simulation

from app.files.extras import check_installed
from app.geometry import NS_PER_MS, NS_PER_S, MarginGuardError, SurfaceMesh, Transform
from benchmarks.ros_domain import reserved_domain

if TYPE_CHECKING:
    from app.bridge.tf.wire import TfMessageReader, TfSample
    from app.bridge.world_editor import WorldEditor

BODIES, RATE_HZ = 26, 200
SPACING_MM, STEP_MM = 60.0, 0.01
REFERENCE_MS = 13.6
"""One way in the reference: from AMBF to the scene, 26 bodies at 200 Hz."""


def write_world(folder: Path) -> Path:
    """Write a world with `BODIES` fixed cubes beside each other to ``folder``."""
    from app.files.meshes import write_mesh

    corners = [[x, y, z] for x in (-10, 10) for y in (-10, 10) for z in (-10, 10)]
    faces = [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
    write_mesh(folder / "cube.stl", SurfaceMesh("cube", np.array(corners, float), np.array(faces)))
    lines = ["schema: 1", "name: edits", "seed: 1", "bodies:"]
    lines += [
        f"  - {{name: body{number}, motion: fixed, position_mm: [0, {SPACING_MM * number:g}, 0], "
        "mesh: {path: cube.stl, units: mm}}"
        for number in range(BODIES)
    ]
    file = folder / "world.yaml"
    file.write_text("\n".join(lines) + "\n")
    return file


class RoundTrips:
    """The scene: edits all bodies, and follows /tf. Delays in ns by the number of the edit."""

    def __init__(self, editor: "WorldEditor") -> None:
        from slicer import vtkMRMLScene

        from app.bridge.world_editor import TRUTH, WORLD
        from app.scene.frames.edited_world import EditedWorld

        self._prefix, self._frame = TRUTH, WORLD
        self._refused: list[MarginGuardError] = []
        self.world = EditedWorld(
            vtkMRMLScene(), WORLD, editor.move, self._refused.append, clock_ns=time.time_ns
        )
        self._began: dict[int, int] = {}
        self.delays: dict[int, int] = {}
        self.edits = 0

    def show(self, samples: "Sequence[TfSample]") -> None:
        """Bring a message of /tf into the scene."""
        poses = [
            Transform.from_quaternion(
                each.pose[3:],
                each.pose[:3],
                target=self._frame,
                source=each.child.removeprefix(self._prefix),
            )
            for each in samples
            if each.child.startswith(self._prefix)
        ]
        if not poses:
            return
        self.world.show(poses, samples[0].stamp_ns)
        numbers = {round(float(each.translation_mm[0]) / STEP_MM) for each in poses}
        now_ns = time.monotonic_ns()
        if len(numbers) == 1 and len(poses) == BODIES:
            (number,) = numbers
            for edit in [each for each in self._began if each <= number]:
                self.delays[edit] = now_ns - self._began.pop(edit)

    def edit(self) -> None:
        """Move the node of each body by a little, and send the request."""
        from app.scene.nodes.convert import vtk_matrix

        self.edits += 1
        number = self.edits
        self._began[number] = time.monotonic_ns()
        for body in range(BODIES):
            place = np.array([STEP_MM * number, SPACING_MM * body, 0.0])
            node = self.world.node(f"body{body}")
            assert node is not None
            pose = Transform(self._frame, f"body{body}", np.eye(3), place)
            node.SetMatrixTransformToParent(vtk_matrix(pose))
        self.world.send()


def measure(folder: Path, seconds: float) -> RoundTrips:
    """Start the simulation, and edit its bodies for ``seconds``. Raises `MarginGuardError`."""
    from app.bridge import RosNode, topics
    from app.bridge.tf.wire import TfMessageReader
    from app.bridge.world_editor import SIMULATION, WorldEditor

    with running_simulation(write_world(folder)), RosNode("scene") as ros:
        trips, read = RoundTrips(editor := WorldEditor(ros, SIMULATION)), TfMessageReader()
        arrived: list[bytes] = []
        wake = threading.Event()

        def take(data: bytes) -> None:
            arrived.append(data)
            wake.set()

        ros.subscribe(topics.TF, take, raw=True)
        _run(trips, editor, arrived, wake, read, seconds)
    return trips


def _run(
    trips: RoundTrips,
    editor: "WorldEditor",
    arrived: list[bytes],
    wake: threading.Event,
    read: "TfMessageReader",
    seconds: float,
) -> None:
    """The scene's loop: show what comes, edit when it is time."""
    period_ns = NS_PER_S // RATE_HZ
    deadline_ns = time.monotonic_ns() + round(START_TIMEOUT_S * NS_PER_S)
    due_ns = end_ns = 0
    while True:
        now_ns = time.monotonic_ns()
        if not end_ns and len(trips.world.bodies) == BODIES and editor.is_connected():
            due_ns, end_ns = now_ns, now_ns + round(seconds * NS_PER_S)
        if end_ns and now_ns >= end_ns + NS_PER_S // 2:
            return
        if not end_ns and now_ns > deadline_ns:
            raise MarginGuardError("simulation: no poses come; expected them on /tf")
        if end_ns and due_ns <= now_ns < end_ns:
            trips.edit()
            due_ns += period_ns
        while arrived:
            trips.show(read(arrived.pop(0)))
        wake.clear()
        wait_ns = (due_ns if end_ns else now_ns + 10 * NS_PER_MS) - time.monotonic_ns()
        if not arrived and wait_ns > 0:
            wake.wait(min(wait_ns, 10 * NS_PER_MS) / NS_PER_S)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; return its exit status."""
    parser = argparse.ArgumentParser(prog="marginguard bench edits", description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="duration (default: 20)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(arguments)
    if not 0.1 <= options.seconds <= 3600.0:
        parser.error(f"--seconds is {options.seconds:g}; expected 0.1 to 3600")
    try:
        check_installed("mujoco", "rclpy", "slicer")
        with reserved_domain() as domain, tempfile.TemporaryDirectory() as name:
            from app.bridge import prepare_environment

            os.environ["ROS_DOMAIN_ID"] = str(domain)
            prepare_environment(os.environ)
            trips = measure(Path(name), options.seconds)
    except MarginGuardError as error:
        print(f"marginguard bench edits: {error}", file=sys.stderr)
        return 2
    delays_ms = np.array([*trips.delays.values()]) / NS_PER_MS
    share = len(delays_ms) / max(trips.edits, 1)
    found = {
        "edits": trips.edits,
        "came_back": len(delays_ms),
        "mean_ms": round(float(delays_ms.mean()), 2) if len(delays_ms) else None,
        "p99_ms": round(float(np.percentile(delays_ms, 99)), 2) if len(delays_ms) else None,
        "max_ms": round(float(delays_ms.max()), 2) if len(delays_ms) else None,
        "load": os.getloadavg()[0],
    }
    if options.json:
        print(json.dumps(found))
    else:
        print(
            f"{found['edits']} edits of {BODIES} bodies at {RATE_HZ} Hz, {100 * share:.1f} % came "
            f"back: mean {found['mean_ms']} ms, p99 {found['p99_ms']} ms, largest "
            f"{found['max_ms']} ms for the round trip; reference, one way: {REFERENCE_MS} ms; "
            f"load {found['load']:.1f}"
        )
    return 0 if share >= 0.9 else 1


if __name__ == "__main__":
    sys.exit(main())
