"""Duration of a replay of a recorded case, from the command to the last report file.

    marginguard bench replay [CASE] [--runs 5] [--minutes 30] [--ros] [--json FILE]

The whole command runs several times, each in a process of its own, without ROS. Each part is
printed beside its goal, and the time to read a frame beside rosbags' decoding of the same messages.
The command waits for ``scene.png`` at its end, which another process draws from the start on: that
time is stated apart. With ``--ros`` the command runs once more and publishes. Wall-clock and
processor time and the phases are those of the fastest run, the one least disturbed by other work.
"x real time" is the recording's duration divided by the wall-clock time; *inside* counts from the
opened case to the last report file, without loading the program. The cost of reading and stepping
one frame dominates long recordings and is printed separately. With ``--minutes`` the case's
recording is first repeated up to that length, which takes a while.
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

from app.bridge.environment import DOMAIN
from app.cli.progress import with_progress
from benchmarks.case_options import RECORDED_CASE, case_folder
from benchmarks.long_case import write_long_case
from benchmarks.replay_decoding import read_ms_per_frame
from benchmarks.ros_domain import reserved_domain

CHECKOUT = Path(__file__).resolve().parents[1]
BEFORE_THE_CASE = ("start and end", "load the program", "open the case")
FRAMES = "read the frames and step"
_LAP = re.compile(r"^ *([0-9.]+) s  (.+)$", re.MULTILINE)

SCENE_PICTURE = "wait for scene.png"
MESHES = "meshes, robot, registration"
ANALYSIS = "analyse the steps"
GOALS_S = {"load the program": 0.7, MESHES: 0.3, ANALYSIS: 3.0, "write the report": 0.4}
FRAME_GOAL_MS, CASE_GOAL_S, ROS_GOAL_S, LONG_GOAL = 0.12, 1.9, 3.0, 140.0
LONG_S = 1000.0
"""Recordings from here on have a goal in multiples of real time, shorter ones in seconds."""

MAX_MINUTES = 600.0


def run(case: Path, report: Path, *, domain: int | None = None) -> dict[str, Any]:
    """Run one replay; returns ``wall_s``, ``cpu_s`` of all its processes, and ``phases_s``.

    Publishes in the ROS ``domain``; None runs without ROS. Python keeps compiled modules, as in an
    installation, even if this process does not.
    """
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
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
    if domain is not None:
        environment[DOMAIN] = str(domain)
    without_ros = ["--no-ros"] if domain is None else []
    done = subprocess.run(
        [*command, *without_ros, "--timing"],
        cwd=CHECKOUT,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    wall_s = time.perf_counter() - start_s
    laps = {name: float(seconds) for seconds, name in _LAP.findall(done.stderr)}
    phases = {"start and end": wall_s - sum(laps.values()), **laps}
    return {"wall_s": wall_s, "cpu_s": _children_cpu_s() - cpu_s, "phases_s": phases}


def summary(runs: list[dict[str, Any]], duration_s: float, frames: int) -> dict[str, Any]:
    """The fastest of ``runs`` with its ratios to the recording's duration."""
    fastest = min(runs, key=lambda each: float(each["wall_s"]))
    frames_s = fastest["phases_s"][FRAMES]
    apart = (SCENE_PICTURE, ANALYSIS)
    outside = (*BEFORE_THE_CASE, *apart)
    inside_s = sum(s for name, s in fastest["phases_s"].items() if name not in outside)
    apart_s = sum(fastest["phases_s"].get(name, 0.0) for name in apart)
    return {
        **fastest,
        "duration_s": duration_s,
        "frames": frames,
        "ms_per_frame": 1000.0 * frames_s / frames,
        "times_real_time_of_frames": duration_s / frames_s,
        "inside_s": inside_s,
        "without_picture_s": fastest["wall_s"] - apart_s,
        "times_real_time": duration_s / (fastest["wall_s"] - apart_s),
        "times_real_time_inside": duration_s / inside_s,
        "walls_s": [each["wall_s"] for each in runs],
        "processors": os.cpu_count(),
        "load_average": os.getloadavg()[0],
    }


def main() -> None:
    """Measure, print a table, and write the figures if requested."""
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
    parser.add_argument("--ros", action="store_true", help="run once more with ROS")
    parser.add_argument("--json", type=Path, help="write the figures there as well")
    options = parser.parse_args()
    if options.runs < 1:
        parser.error(f"--runs is {options.runs}; expected 1 or more")
    if options.minutes is not None and not 0.0 < options.minutes <= MAX_MINUTES:
        parser.error(
            f"--minutes is {options.minutes:g}; expected more than 0, at most {MAX_MINUTES:g}"
        )
    with tempfile.TemporaryDirectory() as folder:
        case, report = options.case, Path(folder) / "report"
        run(case, report)  # fills the caches of kernels and compiled modules
        if options.minutes is not None:
            case = Path(folder) / "case"
            write_long_case(case, options.case, 60.0 * options.minutes)
        runs = [run(case, report) for _ in with_progress(range(options.runs), "run")]
        report_summary = json.loads((report / "summary.json").read_text())
        with_ros = None
        if options.ros:
            with reserved_domain() as domain:
                with_ros = run(case, report, domain=domain)
        read_ms, rosbags_ms = read_ms_per_frame(case)
    found = summary(runs, report_summary["duration_s"], report_summary["frames"])
    found |= {"read_ms_per_frame": read_ms, "rosbags_ms_per_frame": rosbags_ms}
    found["with_ros"] = with_ros
    for name, seconds in found["phases_s"].items():
        print(f"{seconds:9.3f} s  {name}{_goal(seconds, GOALS_S.get(name), 's')}")
    print(f"{found['wall_s']:9.3f} s  the whole command")
    is_long = found["duration_s"] >= LONG_S
    case_goal_s = found["duration_s"] / LONG_GOAL if is_long else CASE_GOAL_S
    print(
        f"{found['without_picture_s']:9.3f} s  without analysis and wait for scene.png, "
        f"{found['times_real_time']:.1f} x real time"
        f"{_goal(found['without_picture_s'], case_goal_s, 's')}"
    )
    if with_ros is not None:
        phases = with_ros["phases_s"]
        seconds = with_ros["wall_s"] - phases.get(SCENE_PICTURE, 0.0) - phases.get(ANALYSIS, 0.0)
        ros_goal = None if is_long else ROS_GOAL_S
        print(f"{seconds:9.3f} s  the same with ROS{_goal(seconds, ros_goal, 's')}")
    print(f"{found['inside_s']:9.3f} s  inside, {found['times_real_time_inside']:.1f} x real time")
    print(
        f"{found['ms_per_frame']:9.3f} ms to read and step a frame, of {found['frames']} in "
        f"{found['duration_s']:.1f} s; {found['times_real_time_of_frames']:.1f} x real time"
        f"{_goal(found['ms_per_frame'], FRAME_GOAL_MS, 'ms')}"
    )
    peer = "" if rosbags_ms is None else f"; rosbags' decoding alone takes {rosbags_ms:.3f} ms"
    print(f"{read_ms:9.3f} ms of processor time to read a frame{peer}")
    print(
        f"{found['cpu_s']:9.3f} s  of processor time on {found['processors']} processors, "
        f"load average {found['load_average']:.1f}"
    )
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=1) + "\n")


def _goal(value: float, goal: float | None, unit: str) -> str:
    if goal is None:
        return ""
    return f" (goal {goal:.3g} {unit}: {'met' if value <= goal else 'not met'})"


def _children_cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    main()
