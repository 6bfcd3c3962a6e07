"""A simulated cohort with 1, 2 and more workers: wall clock, memory of each worker, equal bytes.

Each number of workers runs the whole cohort into a folder of its own, with the command of a user.
Then the same command runs again, which has nothing to do, and the cohort runs once more while two
workers are killed. Cases are made by the workers and not stored. With --keep the figures of each
finished run are kept: the same command continues with the runs that are left, and --minutes ends a
part in time. Exit status: 1 when a goal is missed or runs are left.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cohort.run import Run, command_of, run_cohort, second_run
from benchmarks.harness.figures import Goal, goals_table, show, write_json
from benchmarks.harness.options import BenchParser

CASE_CPU_S = 3.0
SECOND_RUN_S = 10.0
MAX_GROWTH = 0.05
"""Share by which a worker's memory may be higher in the last quarter of its cases than in the first
quarter, after the warm-up."""
KILLS = 2
FIGURES = "figures.json"


def main() -> int:
    options = _options()
    with ExitStack() as stack:
        folder = options.keep
        if folder is None:
            temporary = tempfile.TemporaryDirectory(dir=options.scratch, prefix="bench-cohort-")
            folder = Path(stack.enter_context(temporary))
        folder.mkdir(exist_ok=True)
        figures = _figures(folder, options)
        left = _run_parts(folder, options, figures)
    runs = [_run_of(figures["runs"][name]) for name in _parts(options) if name in figures["runs"]]
    if left:
        print(f"left: {', '.join(left)}; the same command continues")
        return 1
    goals = goals_of(runs, figures["second_run_s"], unchanged=figures["unchanged"])
    cpu_s = float(np.mean([run.cpu_s_per_case for run in runs]))
    cost = f"a million cases: {cpu_s * 1e6 / 3600:.0f} core hours at {cpu_s:.1f} s each"
    show(goals_table(goals), cost)
    wrong = [goal.what for goal in goals if not goal.good]
    write_json(options.json, {**figures, "missed": wrong})
    return 1 if wrong else 0


def goals_of(runs: list[Run], second_s: float, *, unchanged: bool) -> list[Goal]:
    """The goals. The last run has the kills."""
    cpu_s = min(run.cpu_s_per_case for run in runs)
    digests = sorted({run.digest for run in runs})
    growths = [run.growth for run in runs if run.growth is not None]
    growth = f"{100 * max(growths):+.1f} %" if growths else "too few cases"
    whole = [run for run in runs if not run.killed and run.workers <= _processors()]
    falls = all(more.wall_s < fewer.wall_s for fewer, more in pairwise(whole))
    walls = ", ".join(f"{run.wall_s:.0f} s with {run.workers}" for run in whole)
    killed, again = runs[-1].killed, f"{second_s:.1f} s, bytes equal: {unchanged}"
    rows = (
        (f"processor time of a case at most {CASE_CPU_S:g} s", f"{cpu_s:.1f} s",
         cpu_s <= CASE_CPU_S),
        ("equal bytes of all runs", " ".join(digests), len(digests) == 1),
        (f"{KILLS} workers killed", f"{killed}", killed == KILLS),
        (f"second run under {SECOND_RUN_S:g} s, without a change", again,
         second_s < SECOND_RUN_S and unchanged),
        (f"memory of a worker grows by {100 * MAX_GROWTH:g} % at most", growth,
         max(growths, default=0.0) <= MAX_GROWTH),
        ("wall clock falls with workers up to the number of processors", walls, falls),
    )  # fmt: skip
    return [Goal(*row) for row in rows]


def _parts(options: Any) -> dict[str, tuple[int, int]]:
    """Name of each run: its number of workers, and how many of them are killed."""
    parts = {f"workers-{workers}": (workers, 0) for workers in options.workers}
    return {**parts, "killed": (max(options.workers), KILLS)}


def _run_parts(folder: Path, options: Any, figures: dict[str, Any]) -> list[str]:
    """Do the runs that are left; returns those for which the time does not suffice."""
    study, begin = folder / "study", time.monotonic()
    if not study.is_dir():
        made = ["make-cohort", "-n", options.cases, "--seed", options.seed, "--out", study]
        made += ["--tracker", "aurora", "--duration", options.duration]
        if subprocess.run(command_of(*made), stdout=subprocess.DEVNULL).returncode:
            raise SystemExit("no cohort was made; expected options of marginguard make-cohort")
    left = []
    for name, (workers, kills) in _parts(options).items():
        out = folder / name
        if name in figures["runs"]:
            print(f"{_run_of(figures['runs'][name]).line} (earlier)")
            continue
        minutes = (time.monotonic() - begin) / 60.0 + _expected_minutes(figures, workers)
        if options.minutes is not None and minutes > options.minutes:
            left.append(name)
            continue
        if out.is_dir():
            shutil.rmtree(out)  # of a run that was interrupted: its wall clock is not known
        run = run_cohort(study, out, workers, kills=kills)
        print(run.line, flush=True)
        figures["runs"][name] = asdict(run)
        if name == f"workers-{options.workers[-1]}":
            figures["second_run_s"], figures["unchanged"] = second_run(study, out, workers)
        (folder / FIGURES).write_text(json.dumps(figures, indent=2) + "\n")
    return left


def _expected_minutes(figures: dict[str, Any], workers: int) -> float:
    """Duration of a run by the wall clock of those before, also on a busy machine; 0 without."""
    at_once = [min(run["workers"], _processors()) for run in figures["runs"].values()]
    walls_s = [run["wall_s"] for run in figures["runs"].values()]
    one_s = max((wall_s * count for wall_s, count in zip(walls_s, at_once, strict=True)), default=0)
    return one_s * 1.1 / min(workers, _processors()) / 60.0


def _figures(folder: Path, options: Any) -> dict[str, Any]:
    """The figures of earlier parts in ``folder``, which must be of the same cohort."""
    from app import __version__

    cohort = {name: getattr(options, name) for name in ("cases", "duration", "seed")}
    cohort["version"] = __version__
    path = folder / FIGURES
    if not path.is_file():
        return {"cohort": cohort, "runs": {}}
    figures: dict[str, Any] = json.loads(path.read_text())
    if figures["cohort"] != cohort:
        raise SystemExit(f"--keep {folder}: it holds {figures['cohort']}; expected {cohort}")
    return figures


def _run_of(values: dict[str, Any]) -> Run:
    low, high = values["rss_mb"]
    return Run(**{**values, "rss_mb": (low, high)})


def _processors() -> int:
    return len(os.sched_getaffinity(0))


def _options() -> Any:
    parser = BenchParser("cohort", __doc__)
    parser.number("--cases", 12, "number of cases")
    parser.number("--workers", [1, 2], "numbers of workers")
    parser.number("--duration", 75.0, "length of a case in s")
    parser.add_argument("--seed", type=int, default=1, help="seed of the cohort (default: 1)")
    parser.add_argument("--scratch", type=Path, help="existing folder for the results")
    parser.add_argument("--keep", type=Path, help="folder that keeps results and finished runs")
    parser.add_argument(
        "--minutes", type=float, help="begin no run that would end later, by the runs before it"
    )
    options = parser.parse_args()
    if options.scratch is not None and not options.scratch.is_dir():
        parser.error(f"--scratch {options.scratch}: no such folder; expected an existing one")
    if options.minutes is not None and options.keep is None:
        parser.error("--minutes without --keep: the runs would be lost; expected both")
    return options


if __name__ == "__main__":
    sys.exit(main())
