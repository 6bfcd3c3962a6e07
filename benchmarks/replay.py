"""How long a replay of a recorded case takes, from the command to the last report file.

    marginguard bench replay [CASE] [--runs 5] [--minutes 30] [--json FILE]

The whole command is run again and again, in processes of its own, without ROS. Told are its wall
clock and processor time and its phases, of the fastest run: on a machine that does other work too,
that is the run that was disturbed least. Times real time is the recording's duration over the wall
clock; *inside* counts from the opened case to the last report file, without the program's loading.
What a frame costs, to be read and stepped, is what decides for a long recording: it is told, and
how many times real time that alone would be. With ``--minutes`` the case's recording is repeated up
to that length first, which takes a while.
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
from pathlib import Path
from typing import Any

from benchmarks.case_options import RECORDED_CASE, case_folder
from benchmarks.long_case import write_long_case

CHECKOUT = Path(__file__).resolve().parents[1]
BEFORE_THE_CASE = ("start and end", "load the program", "open the case")
FRAMES = "read the frames and step"
_LAP = re.compile(r"^ *([0-9.]+) s  (.+)$", re.MULTILINE)

MOST_MINUTES = 600.0


def run(case: Path, report: Path) -> dict[str, Any]:
    """One replay: ``wall_s``, ``cpu_s`` of all its processes, and ``phases_s``."""
    command = [
        sys.executable,
        "-m",
        "app.cli",
        "replay",
        str(case.resolve()),
        "--report",
        str(report),
    ]
    cpu_s, start_s = _children_cpu_s(), time.perf_counter()
    done = subprocess.run(
        [*command, "--no-ros", "--timing"], cwd=CHECKOUT, capture_output=True, text=True, check=True
    )
    wall_s = time.perf_counter() - start_s
    laps = {name: float(seconds) for seconds, name in _LAP.findall(done.stderr)}
    phases = {"start and end": wall_s - sum(laps.values()), **laps}
    return {"wall_s": wall_s, "cpu_s": _children_cpu_s() - cpu_s, "phases_s": phases}


def summary(runs: list[dict[str, Any]], duration_s: float, frames: int) -> dict[str, Any]:
    """The fastest of ``runs``, and how many times faster than the recording it is."""
    fastest = min(runs, key=lambda each: float(each["wall_s"]))
    frames_s = fastest["phases_s"][FRAMES]
    inside_s = sum(s for name, s in fastest["phases_s"].items() if name not in BEFORE_THE_CASE)
    return {
        **fastest,
        "duration_s": duration_s,
        "frames": frames,
        "ms_per_frame": 1000.0 * frames_s / frames,
        "times_real_time_of_frames": duration_s / frames_s,
        "inside_s": inside_s,
        "times_real_time": duration_s / fastest["wall_s"],
        "times_real_time_inside": duration_s / inside_s,
        "walls_s": [each["wall_s"] for each in runs],
        "processors": os.cpu_count(),
        "load_average": os.getloadavg()[0],
    }


def main() -> None:
    """Measure, print a table, and write the figures where they are wanted."""
    parser = argparse.ArgumentParser(
        prog="marginguard bench replay", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "case",
        type=case_folder,
        nargs="?",
        default=RECORDED_CASE,
        help="default: data/recorded_case",
    )
    parser.add_argument("--runs", type=int, default=5, help="default: 5; the fastest counts")
    parser.add_argument("--minutes", type=float, help="repeat the recording up to this length")
    parser.add_argument("--json", type=Path, help="write the figures there as well")
    options = parser.parse_args()
    if options.runs < 1:
        parser.error(f"--runs {options.runs}: 1 or more wanted")
    if options.minutes is not None and not 0.0 < options.minutes <= MOST_MINUTES:
        parser.error(f"--minutes {options.minutes}: more than 0, at most {MOST_MINUTES:g} wanted")
    with tempfile.TemporaryDirectory() as folder:
        case, report = options.case, Path(folder) / "report"
        run(case, report)  # compiles what is not compiled yet
        if options.minutes is not None:
            case = Path(folder) / "case"
            write_long_case(case, options.case, 60.0 * options.minutes)
        runs = [run(case, report) for _ in range(options.runs)]
        told = json.loads((report / "summary.json").read_text())
    found = summary(runs, told["duration_s"], told["frames"])
    for name, seconds in found["phases_s"].items():
        print(f"{seconds:9.3f} s  {name}")
    print(
        f"{found['wall_s']:9.3f} s  the whole command, {found['times_real_time']:.1f} x real time"
    )
    print(f"{found['inside_s']:9.3f} s  inside, {found['times_real_time_inside']:.1f} x real time")
    print(
        f"{found['ms_per_frame']:9.3f} ms to read and step a frame, of {found['frames']} in "
        f"{found['duration_s']:.1f} s; {found['times_real_time_of_frames']:.1f} x real time"
    )
    print(
        f"{found['cpu_s']:9.3f} s  of processor time on {found['processors']} processors, "
        f"load average {found['load_average']:.1f}"
    )
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=1) + "\n")


def _children_cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    main()
