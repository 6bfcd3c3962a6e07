"""Latency of a pose from another process to the scene: ours beside timers and OpenIGTLink.

A process sends 26 bodies 200 times a second. Measured is the time from the stamp of the first body
to the end of the update of all models in the MRML scene, without rendering. Each receiver runs in
two turns, so that other work on the machine affects all of them. Exit status 1 when ours misses a
required latency.
"""

import argparse
import json
import os
import platform
import sys
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from app.bridge import prepare_environment
from app.cli.progress import with_progress
from benchmarks.fixture.table import targets_table
from benchmarks.latency.measure import measure
from benchmarks.latency.plot import write_plots
from benchmarks.latency.receivers import KINDS
from benchmarks.latency.results import Run, speed_targets
from benchmarks.latency.table import NOTES, runs_table

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
    parser.add_argument("--bodies", type=int, default=BODIES, help=f"default: {BODIES}")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="draw the delays there")
    options = parser.parse_args()
    if options.seconds < 1.0 or options.bodies < 1:
        parser.error(
            f"--seconds is {options.seconds:g}, --bodies is {options.bodies}; expected 1 or more"
        )
    return options


def main() -> int:
    options = parsed()
    # A separate domain keeps other ROS traffic of this machine out of the figures.
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
    prepare_environment()
    runs: dict[str, Run] = {}
    for kind in with_progress(KINDS * TURNS, "turns"):
        run = measure(kind, options.seconds / TURNS, options.bodies)
        runs[kind.name] = runs[kind.name].concatenated(run) if kind.name in runs else run
    machine = {"cores": os.cpu_count(), "kind": platform.machine(), "load": os.getloadavg()[0]}
    console = Console(width=None if sys.stdout.isatty() else 150)
    title = f"{options.bodies} bodies at 200 Hz, stamp to scene in ms; {machine['cores']} cores"
    console.print(runs_table(runs.values(), title))
    console.print(NOTES, highlight=False)
    verdict = list(speed_targets(runs))
    console.print(targets_table(verdict))
    if options.json is not None:
        document = {
            "machine": machine,
            "bodies": options.bodies,
            "ways": [run.document() for run in runs.values()],
            "wishes": [asdict(target) for target in verdict],
        }
        options.json.write_text(json.dumps(document, indent=1) + "\n")
    if options.plots is not None:
        write_plots(list(runs.values()), options.plots)
    return int(any(target.good is False for target in verdict))


if __name__ == "__main__":
    sys.exit(main())
