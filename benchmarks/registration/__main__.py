"""Accuracy of registration and calibration, compared with other implementations in the same run.

    marginguard bench registration [--quick] [--only TOPIC] [--json FILE]

Exit status 1 if a figure is outside its limits.
"""

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

from app.cli.progress import with_progress
from benchmarks.registration.bad_input import bad_input
from benchmarks.registration.covariances import calibration_of_covariances
from benchmarks.registration.figures import Figure
from benchmarks.registration.noise_free import noise_free
from benchmarks.registration.pivots import pivots
from benchmarks.registration.recording import recording
from benchmarks.registration.robot_world import robot_world
from benchmarks.registration.surfaces import surfaces
from benchmarks.registration.target_error import target_error
from benchmarks.registration.time_offsets import time_offsets

TOPICS: tuple[tuple[Callable[[int], Iterator[Figure]], int, int], ...] = (
    (recording, 1, 1),
    (noise_free, 1000, 30),
    (robot_world, 200, 20),
    (target_error, 100, 5),
    (calibration_of_covariances, 500, 40),
    (pivots, 200, 20),
    (time_offsets, 400, 40),
    (surfaces, 40, 5),
    (bad_input, 1, 1),
)
"""The topics, with their numbers of trials in full and with ``--quick``."""


def run(*, quick: bool, only: str = "") -> Iterator[Figure]:
    """Yield the figures of the topics whose name contains ``only``, as they are computed."""
    topics = [each for each in TOPICS if only in each[0].__name__]
    for topic, full, short in with_progress(topics, "topic"):
        yield from topic(short if quick else full)


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="marginguard bench registration", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--quick", action="store_true", help="few trials, rough figures")
    parser.add_argument("--only", default="", help="topics whose name contains this")
    parser.add_argument("--json", type=Path, help="write the figures to this file, too")
    arguments = parser.parse_args()
    names = [topic.__name__ for topic, _, _ in TOPICS]
    if not any(arguments.only in name for name in names):
        parser.error(
            f"--only {arguments.only}: no such topic; expected a part of {', '.join(names)}"
        )
    figures = []
    for figure in run(quick=arguments.quick, only=arguments.only):
        figures.append(figure)
        verdict = {True: "ok  ", False: "MISS", None: "    "}[figure.good]
        expected = f"   expected {figure.wanted}" if figure.wanted else ""
        peer = f"   peer: {figure.peer}" if figure.peer else ""
        print(f"{verdict} {figure.topic}: {figure.what}: {figure.ours}{expected}{peer}", flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(f) for f in figures], indent=1) + "\n")
    return int(any(figure.good is False for figure in figures))


if __name__ == "__main__":
    sys.exit(main())
