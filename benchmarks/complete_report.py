"""Duration of all results of a recorded case beyond its replay.

    marginguard bench report [CASE] [--runs 3] [--json FILE]

``replay --no-ros`` and ``replay --no-ros --report DIR --all`` run in turn, each in a process of its
own with warm caches. The fastest run of each counts, the one least disturbed by other work. Their
difference has a goal of 3 s. The parts of the fastest complete run are printed: wall-clock time of
the command, processor time of the parts that other processes make meanwhile.
"""

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from app.cli.progress import with_progress
from benchmarks.case_options import RECORDED_CASE, case_folder

CHECKOUT = Path(__file__).resolve().parents[1]
GOAL_S = 3.0
_LAP = re.compile(r"^ *([0-9.]+) s  (.+)$", re.MULTILINE)


def run(case: Path, *options: str) -> dict[str, Any]:
    """Replay ``case``: ``wall_s``, ``cpu_s`` of all processes, and the ``parts_s`` it printed."""
    command = [sys.executable, "-m", "app.cli", "replay", str(case.resolve()), "--no-ros"]
    before, start_s = _children_cpu_s(), time.perf_counter()
    done = subprocess.run(
        [*command, "--timing", *options],
        cwd=CHECKOUT,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": ""},
        capture_output=True,
        text=True,
        check=True,
    )
    return {
        "wall_s": time.perf_counter() - start_s,
        "cpu_s": _children_cpu_s() - before,
        "parts_s": {name: float(seconds) for seconds, name in _LAP.findall(done.stderr)},
    }


def compared(replays: Sequence[dict[str, Any]], complete: Sequence[dict[str, Any]]) -> Any:
    """The fastest run of each, and the time that the complete one takes longer."""
    shortest, full = (min(runs, key=lambda each: each["wall_s"]) for runs in (replays, complete))
    return {
        "replay": shortest,
        "complete": full,
        "beyond_s": full["wall_s"] - shortest["wall_s"],
        "beyond_cpu_s": full["cpu_s"] - shortest["cpu_s"],
        "walls_s": {
            "replay": [each["wall_s"] for each in replays],
            "complete": [each["wall_s"] for each in complete],
        },
    }


def main() -> int:
    """Measure, print a table, and write the figures if requested."""
    parser = argparse.ArgumentParser(
        prog="marginguard bench report", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "case",
        type=case_folder,
        nargs="?",
        default=RECORDED_CASE,
        help="default: data/recorded_case",
    )
    parser.add_argument("--runs", type=int, default=3, help="default: 3; the fastest counts")
    parser.add_argument("--json", type=Path, help="write the figures there as well")
    options = parser.parse_args()
    if options.runs < 1:
        parser.error(f"--runs is {options.runs}; expected 1 or more")
    replays, complete = [], []
    with tempfile.TemporaryDirectory() as folder:
        every = ("--report", str(Path(folder) / "report"), "--all")
        run(options.case, *every)  # fills the caches of kernels and compiled modules
        for _ in with_progress(range(options.runs), "run"):
            replays.append(run(options.case))
            complete.append(run(options.case, *every))
    found = compared(replays, complete)
    found |= {"processors": os.cpu_count(), "load_average": os.getloadavg()[0]}
    for name, seconds in found["complete"]["parts_s"].items():
        print(f"{seconds:9.3f} s  {name}")
    print(f"{found['complete']['wall_s']:9.3f} s  replay with all results")
    print(f"{found['replay']['wall_s']:9.3f} s  replay alone")
    met = "met" if found["beyond_s"] <= GOAL_S else "not met"
    print(f"{found['beyond_s']:9.3f} s  beyond the replay (goal {GOAL_S:g} s: {met})")
    print(
        f"{found['beyond_cpu_s']:9.3f} s  of processor time beyond it, on {found['processors']} "
        f"processors, load average {found['load_average']:.1f}"
    )
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0 if found["beyond_s"] <= GOAL_S else 1


def _children_cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    sys.exit(main())
