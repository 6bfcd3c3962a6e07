"""Latency of a pose from another process to the scene, in the product and beside its peers.

A process sends 26 bodies 200 times a second. Measured is the time from the stamp to the end of the
update of the MRML scene: in the module ROS2 of desktop Slicer, in its panel MarginGuard and in the
live page, woken by messages; beside timers as before, OpenIGTLink, and rclpy without a scene. Then
a robot's joint starts and stops 15 times, and two robots do at once. Each receiver runs in turns,
so that other work on the machine affects all of them. Exit status 1 when the module misses a
required latency.
"""

import argparse
import json
import os
import platform
import sys
import tempfile
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rich.console import Console

from app.cli.progress import with_progress
from app.files.extras import install_command
from benchmarks.faults.environment import prepare
from benchmarks.fixture.table import targets_table
from benchmarks.ros_domain import reserved_domain

BODIES = 26
TURNS = 2


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="marginguard bench latency",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--seconds", type=float, default=20.0, help="for each receiver (default: 20)"
    )
    parser.add_argument("--turns", type=int, default=TURNS, help=f"default: {TURNS}")
    parser.add_argument("--bodies", type=int, default=BODIES, help=f"default: {BODIES}")
    parser.add_argument(
        "--only", metavar="TEXT", default="", help="receivers with TEXT in their name"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="draw the delays there")
    options = parser.parse_args()
    for name in ("seconds", "bodies", "turns"):
        if getattr(options, name) < 1:
            parser.error(f"--{name} is {getattr(options, name):g}; expected 1 or more")
    if options.only and options.plots is not None:
        parser.error("--plots is given with --only; expected all receivers")
    return options


def main() -> int:
    options = parsed()
    if find_spec("PySide6") is None:
        print(f"bench latency: PySide6 is missing; expected it: {install_command('test')}")
        return 2
    # A separate domain keeps other ROS traffic of this machine out of the figures.
    with reserved_domain() as domain, tempfile.TemporaryDirectory() as folder:
        prepare(domain, Path(folder))
        return measured(options)


def measured(options: argparse.Namespace) -> int:
    """Measure, print and write the results; returns the exit status."""
    from benchmarks.latency.kinds import KINDS, OURS, POLLED
    from benchmarks.latency.measure import measure
    from benchmarks.latency.plot import write_plots
    from benchmarks.latency.results import Run, speed_targets
    from benchmarks.latency.stops import STOP_KINDS, STOPS, measure_stops
    from benchmarks.latency.table import NOTES, runs_table, stops_table

    kinds = [kind for kind in KINDS if options.only in kind.name]
    runs: dict[str, Run] = {}
    for kind in with_progress(kinds * options.turns, "turns"):
        run = measure(kind, options.seconds / options.turns, options.bodies)
        runs[kind.name] = runs[kind.name].concatenated(run) if kind.name in runs else run
    stop_kinds = [kind for kind in STOP_KINDS if options.only in kind.name]
    stops = [run for kind in with_progress(stop_kinds, "robots") for run in measure_stops(kind)]
    machine = {"cores": os.cpu_count(), "kind": platform.machine(), "load": os.getloadavg()[0]}
    console = Console(width=None if sys.stdout.isatty() else 170)
    title = f"{options.bodies} bodies at 200 Hz, stamp to scene in ms; {machine['cores']} cores"
    console.print(runs_table(runs.values(), title))
    console.print(stops_table(stops, f"a joint that stops {STOPS} times, delay at the stop in ms"))
    console.print(NOTES, highlight=False)
    verdict = list(speed_targets(runs)) if {OURS, POLLED} <= runs.keys() else []
    console.print(targets_table(verdict))
    if options.json is not None:
        document: dict[str, Any] = {
            "machine": machine,
            "bodies": options.bodies,
            "ways": [run.document() for run in runs.values()],
            "stops": [run.document() for run in stops],
            "wishes": [asdict(target) for target in verdict],
        }
        options.json.write_text(json.dumps(document, indent=1) + "\n")
    if options.plots is not None:
        write_plots(list(runs.values()), stops, options.plots)
    return int(any(target.good is False for target in verdict))


if __name__ == "__main__":
    sys.exit(main())
