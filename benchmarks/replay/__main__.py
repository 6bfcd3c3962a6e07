"""Duration of a replay of a recorded case, from the command to the last report file.

The whole command runs several times, each in a process of its own, without ROS. Each part is
printed beside its goal, and the time to read a frame beside rosbags' decoding of the same messages.
The command waits for ``scene.png`` at its end, which another process draws from the start on: that
time is stated apart. With ``--ros`` the command runs once more and publishes. Wall-clock and
processor time and the phases are those of the fastest run, the one least disturbed by other work.
"x real time" is the recording's duration divided by the wall-clock time; *inside* counts from the
opened case to the last report file, without loading the program. The cost of reading and stepping
one frame dominates long recordings and is printed separately. With ``--minutes`` the case's
recording is first repeated up to that length.

With ``--report`` ``replay --no-ros`` and ``replay --no-ros --report DIR --all`` run in turns
instead: the fastest complete run, part by part, and how much longer it takes than the fastest
replay alone.
"""

import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from app.bridge.environment import DOMAIN
from app.case import open_case
from app.case.messages.ros_messages import ros_types
from app.geometry import InputError
from benchmarks.harness.figures import in_turns, load, show, table
from benchmarks.harness.goals import at_most, finish
from benchmarks.harness.options import BenchParser
from benchmarks.harness.processes import CLI
from benchmarks.replay.long_case import write_long_case
from benchmarks.ros_domain import reserved_domain

CHECKOUT = Path(__file__).resolve().parents[2]
BEFORE_THE_CASE = ("start and end", "load the program", "open the case")
FRAMES = "read the frames and step"
SCENE_PICTURE = "wait for scene.png"
MESHES = "meshes, robot, registration"
ANALYSIS = "analyse the steps"
GOALS_S = {"load the program": 0.7, MESHES: 0.3, ANALYSIS: 3.0, "write the report": 0.4}
FRAME_GOAL_MS, CASE_GOAL_S, ROS_GOAL_S, LONG_GOAL = 0.12, 1.9, 3.0, 140.0
REPORT_GOAL_S = 3.0
DECODING_ROUNDS = 3
LONG_S = 1000.0  # recordings from here on have a goal in multiples of real time
_LAP = re.compile(r"^ *([0-9.]+) s  (.+)$", re.MULTILINE)
Row = tuple[str, float, str, float | None]  # what, the figure, its unit, its upper limit


def run(case: Path, *options: str, domain: int | None = None) -> dict[str, Any]:
    """Run one replay; returns ``wall_s``, ``cpu_s`` of all its processes, and ``phases_s``.

    Publishes in the ROS ``domain``; None runs without ROS. Python keeps compiled modules, as in an
    installation, even if this process does not.
    """
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
    if domain is not None:
        environment[DOMAIN] = str(domain)
    without_ros = ["--no-ros"] if domain is None else []
    command = [sys.executable, *CLI, "replay", str(case.resolve()), *without_ros, "--timing"]
    cpu_s, start_s = _children_cpu_s(), time.perf_counter()
    settings = {"cwd": CHECKOUT, "env": environment, "capture_output": True, "text": True}
    done = subprocess.run([*command, *options], check=True, **settings)
    wall_s = time.perf_counter() - start_s
    laps = {name: float(seconds) for seconds, name in _LAP.findall(done.stderr)}
    own_s = sum(seconds for name, seconds in laps.items() if not name.startswith("of processor"))
    phases = {"start and end": wall_s - own_s, **laps}
    return {"wall_s": wall_s, "cpu_s": _children_cpu_s() - cpu_s, "phases_s": phases}


def fastest(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The run that was least disturbed by other work."""
    return min(runs, key=lambda each: float(each["wall_s"]))


def summary(runs: list[dict[str, Any]], duration_s: float, frames: int) -> dict[str, Any]:
    """The fastest of ``runs`` with its ratios to the recording's duration."""
    best = fastest(runs)
    phases = best["phases_s"]
    outside = (*BEFORE_THE_CASE, SCENE_PICTURE, ANALYSIS)
    inside_s = sum(s for name, s in phases.items() if name not in outside)
    alone_s = _without_apart(best)
    return {
        **best,
        "duration_s": duration_s,
        "frames": frames,
        "ms_per_frame": 1000.0 * phases[FRAMES] / frames,
        "times_real_time_of_frames": duration_s / phases[FRAMES],
        "inside_s": inside_s,
        "without_picture_s": alone_s,
        "times_real_time": duration_s / alone_s,
        "times_real_time_inside": duration_s / inside_s,
        "walls_s": [each["wall_s"] for each in runs],
    }


def _without_apart(one: Mapping[str, Any]) -> float:
    """Wall-clock time without analysis and the wait for the picture."""
    apart_s = sum(one["phases_s"].get(name, 0.0) for name in (SCENE_PICTURE, ANALYSIS))
    return float(one["wall_s"] - apart_s)


def compared(replays: Sequence[dict[str, Any]], complete: Sequence[dict[str, Any]]) -> Any:
    """The fastest run of each, and the time that the complete one takes longer."""
    shortest, full = fastest(replays), fastest(complete)
    runs = {"replay": replays, "complete": complete}
    return {
        "replay": shortest,
        "complete": full,
        "beyond_s": full["wall_s"] - shortest["wall_s"],
        "beyond_cpu_s": full["cpu_s"] - shortest["cpu_s"],
        "walls_s": {name: [each["wall_s"] for each in some] for name, some in runs.items()},
    }


def read_ms_per_frame(case_folder: Path) -> tuple[float, float | None]:
    """Processor time per frame in ms: ours, and rosbags'; the fastest of `DECODING_ROUNDS`.

    Ours is from the file to the assembled frames. That of rosbags is its decoding of the same
    topics alone, from bytes in memory to its messages; None for a recording without ROS messages.
    Both take turns. Raises `InputError` for a recording without frames.
    """
    case = open_case(case_folder)
    robot = case.manifest.robot
    topics = {"/tracked_transforms", "/tf", robot.joint_states if robot else None}
    recorded = case.recorded_messages()
    kept = [each for each in recorded or () if each.connection.topic in topics]
    messages = [(each.data, each.connection.message_type) for each in kept]
    types = ros_types()

    def decode() -> int:
        for data, kind in messages:
            types.deserialize_cdr(data, kind)
        return len(messages)

    ours, theirs, frames = [], [], 0
    for _ in range(DECODING_ROUNDS):
        seconds, frames = _timed(lambda: sum(1 for _ in case.recorded_frames()))
        ours.append(seconds)
        theirs.append(_timed(decode)[0])
    if not frames:
        raise InputError(f"{case_folder}: its recording has 0 frames; expected 1 or more")
    peer = 1000.0 * min(theirs) / frames if messages else None
    return 1000.0 * min(ours) / frames, peer


def _timed(work: Callable[[], int]) -> tuple[float, int]:
    start_s = time.process_time()
    count = work()
    return time.process_time() - start_s, count


def main() -> int:
    parser = BenchParser("replay", __doc__)
    parser.case("case")
    parser.number("--runs", 5, "the fastest counts")
    text = "repeat the recording up to this length"
    parser.number("--minutes", None, text, low=0, high=600, above=True)
    parser.add_argument("--ros", action="store_true", help="run once more with ROS")
    parser.add_argument("--report", action="store_true", help="all results of the case instead")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        report = str(Path(name) / "report")
        measured = _measured_report if options.report else _measured_replay
        found, rows = measured(options, Path(name), report)
    cells = [(what, f"{value:.3f} {unit}") for what, value, unit, _ in rows]
    show(table(f"load average {load()}", ("", "fastest"), cells))
    limited = [row for row in rows if row[3] is not None]
    goals = [at_most(what, value, limit, unit, ".3f") for what, value, unit, limit in limited]
    return finish(options.json, found, goals)


def _measured_replay(options: Any, folder: Path, report: str) -> tuple[dict[str, Any], list[Row]]:
    case, with_ros = options.case, None
    run(case, "--report", report)  # fills the caches of kernels and compiled modules
    if options.minutes is not None:
        case = folder / "case"
        write_long_case(case, options.case, 60.0 * options.minutes)
    runs = [run(one, "--report", report) for one in in_turns([case], options.runs, "run")]
    results = json.loads((Path(report) / "summary.json").read_text())
    if options.ros:
        with reserved_domain() as domain:
            with_ros = run(case, "--report", report, domain=domain)
    read_ms, rosbags_ms = read_ms_per_frame(case)
    found = summary(runs, results["duration_s"], results["frames"])
    found |= {"read_ms_per_frame": read_ms, "rosbags_ms_per_frame": rosbags_ms}
    found["with_ros"] = with_ros
    is_long = found["duration_s"] >= LONG_S
    goal_s = found["duration_s"] / LONG_GOAL if is_long else CASE_GOAL_S
    rows: list[Row] = [(name, s, "s", GOALS_S.get(name)) for name, s in found["phases_s"].items()]
    rows += [
        ("the whole command", found["wall_s"], "s", None),
        ("without analysis and wait for scene.png", found["without_picture_s"], "s", goal_s),
        ("  times real time", found["times_real_time"], "x", None),
        ("inside", found["inside_s"], "s", None),
        ("  times real time", found["times_real_time_inside"], "x", None),
        (f"read and step one of {found['frames']} frames", found["ms_per_frame"], "ms",
         FRAME_GOAL_MS),
        ("  times real time", found["times_real_time_of_frames"], "x", None),
        ("processor time to read a frame", read_ms, "ms", None),
        ("processor time of all processes", found["cpu_s"], "s", None),
    ]  # fmt: skip
    if with_ros is not None:
        ros_goal = None if is_long else ROS_GOAL_S
        rows.append(("the same with ROS", _without_apart(with_ros), "s", ros_goal))
    if rosbags_ms is not None:
        rows.append(("  rosbags' decoding alone", rosbags_ms, "ms", None))
    return found, rows


def _measured_report(options: Any, folder: Path, report: str) -> tuple[dict[str, Any], list[Row]]:
    every = ("--report", report, "--all")
    run(options.case, *every)  # fills the caches of kernels and compiled modules
    runs: dict[tuple[str, ...], list[dict[str, Any]]] = {(): [], every: []}
    for arguments in in_turns(tuple(runs), options.runs, "run"):
        runs[arguments].append(run(options.case, *arguments))
    found = compared(runs[()], runs[every])
    complete = found["complete"]
    rows: list[Row] = [(name, s, "s", None) for name, s in complete["phases_s"].items()]
    rows += [
        ("replay with all results", complete["wall_s"], "s", None),
        ("replay alone", found["replay"]["wall_s"], "s", None),
        ("beyond the replay", found["beyond_s"], "s", REPORT_GOAL_S),
        ("processor time beyond it", found["beyond_cpu_s"], "s", None),
    ]
    return found, rows


def _children_cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
