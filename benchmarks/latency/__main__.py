"""Latency of a pose from another process to the scene, in the product and beside its peers.

A process sends 26 bodies 200 times a second. Measured is the time from the stamp to the end of the
update of the MRML scene: in the module ROS2 of desktop Slicer, in its panel MarginGuard and in the
live page, woken by messages; beside timers as before, OpenIGTLink, and rclpy without a scene. Then
a robot's joint starts and stops 15 times, and two robots do at once. Each receiver runs in turns,
so that other work on the machine affects all of them.
"""

import os
from pathlib import Path
from typing import Any

from app.cli.progress import with_progress
from benchmarks.harness.figures import columns_table, in_turns, show
from benchmarks.harness.goals import finish
from benchmarks.harness.options import BenchParser
from benchmarks.ros_domain import own_ros


def main() -> int:
    parser = BenchParser("latency", __doc__)
    parser.number("--seconds", 20.0, "for each receiver")
    parser.number("--turns", 2, "of each receiver")
    parser.number("--bodies", 26, "moving bodies")
    text = "receivers with TEXT in their name"
    parser.add_argument("--only", metavar="TEXT", default="", help=text)
    parser.add_argument("--plots", type=Path, metavar="DIR", help="draw the delays there")
    options = parser.parse_args()
    with own_ros():
        return measured(options)


def measured(options: Any) -> int:
    """Measure, print and write the results; returns the exit status."""
    from benchmarks.latency.measure import KINDS, STOP_KINDS, STOPS, measure, measure_stops
    from benchmarks.latency.results import NOTES, RUN_COLUMNS, STOP_COLUMNS, Run, goals, write_plots

    kinds = [kind for kind in KINDS if options.only in kind.name]
    runs: dict[str, Run] = {}
    for kind in in_turns(kinds, options.turns, "turns"):
        run = measure(kind, options.seconds / options.turns, options.bodies)
        runs[kind.name] = runs[kind.name].concatenated(run) if kind.name in runs else run
    stop_kinds = [kind for kind in STOP_KINDS if options.only in kind.name]
    stops = [run for kind in with_progress(stop_kinds, "robots") for run in measure_stops(kind)]
    document = {
        "bodies": options.bodies,
        "ways": [run.document() for run in runs.values()],
        "stops": [run.document() for run in stops],
    }
    title = f"{options.bodies} bodies at 200 Hz, stamp to scene in ms; {os.cpu_count()} cores"
    stops_title = f"a joint that stops {STOPS} times, delay at the stop in ms"
    tables = (
        columns_table(title, document["ways"], RUN_COLUMNS, left=2),
        columns_table(stops_title, document["stops"], STOP_COLUMNS),
    )
    show(*tables, NOTES, width=170)
    if options.plots is not None:
        write_plots(list(runs.values()), stops, options.plots)
    return finish(options.json, document, goals(runs))
