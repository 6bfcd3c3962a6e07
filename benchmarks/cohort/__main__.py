"""A simulated cohort with 1, 2 and more workers: wall clock, memory of each worker, equal bytes.

Each number of workers runs the whole cohort into a folder of its own, with the command of a user.
Then the same command runs again, which has nothing to do, and the cohort runs once more while two
workers are killed. Cases are made by the workers and not stored. With --keep the figures of each
finished run are kept: the same command continues with the runs that are left, and --minutes ends a
part in time. Exit status: 1 when a goal is missed or runs are left.
"""

import csv
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.harness.figures import show
from benchmarks.harness.goals import Goal, at_most, finish, goals_table
from benchmarks.harness.options import BenchParser
from benchmarks.harness.processes import CLI

CASE_CPU_S = 3.0
SECOND_RUN_S = 10.0
MAX_GROWTH = 0.05  # of a worker's memory, last over first quarter of its cases after the warm-up
WARM_UP_CASES = 2  # cases of a worker before which its libraries and kernels are not all loaded
KILLS = 2
FIGURES = "figures.json"


Run = Mapping[str, Any]  # figures of one run: those of `run_cohort`


def line_of(run: Run) -> str:
    growth = "-" if run["growth"] is None else f"{100 * run['growth']:+.1f} %"
    killed = f", {run['killed']} killed" if run["killed"] else ""
    low_mb, high_mb = run["rss_mb"]
    return (
        f"{run['workers']} workers{killed}: {run['wall_s']:.1f} s; a case "
        f"{run['cpu_s_per_case']:.1f} s of processor time, {run['case_wall_s']:.1f} s of wall "
        f"clock; memory of a worker {low_mb:.0f} to {high_mb:.0f} MB, growth "
        f"{growth}; {run['partitions']} partitions, bytes {run['digest']}"
    )


def run_cohort(study: Path, out: Path, workers: int, *, kills: int = 0) -> Run:
    """Run the cohort; kill ``kills`` workers, each after another case has finished.

    ``growth``: the largest of the workers, None with too few cases. ``partitions``: number of files
    of the dataset. ``digest``: of their bytes and the comparison; wall times are in a file of their
    own and not part of it.
    """
    begin = time.perf_counter()
    command = command_of("cohort", study, "--out", out, "--workers", workers)
    killed = 0
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while process.poll() is None:
            time.sleep(0.2)
            if killed < kills and _finished(out) > killed:
                killed += _kill_worker(process.pid)
    if process.returncode != 0:
        raise SystemExit(f"marginguard cohort ended with {process.returncode}; expected 0")
    wall_s = time.perf_counter() - begin
    with (out / "times.csv").open() as file:
        rows = list(csv.DictReader(file))
    memory: dict[str, list[float]] = {}
    for row in rows:  # in the order in which they finished
        memory.setdefault(row["worker"], []).append(float(row["rss_mb"]))
    everything = [value for values in memory.values() for value in values]
    growths = [g for values in memory.values() if (g := growth_of(values)) is not None]
    return {
        "workers": workers, "killed": killed, "wall_s": wall_s,
        "cpu_s_per_case": float(np.mean([float(row["cpu_s"]) for row in rows])),
        "case_wall_s": float(np.mean([float(row["wall_s"]) for row in rows])),
        "rss_mb": (min(everything), max(everything)), "growth": max(growths, default=None),
        "digest": digest_of(out), "partitions": len(list((out / "cases").glob("*.parquet"))),
    }  # fmt: skip


def growth_of(values: list[float]) -> float | None:
    """Memory in the last quarter of a worker's cases after the warm-up, relative to the first one.

    None of too few cases. Halves would show half of a steady growth only.
    """
    warm = values[WARM_UP_CASES:]
    quarter = len(warm) // 4
    if quarter == 0:
        return None
    return float(np.mean(warm[-quarter:]) / np.mean(warm[:quarter])) - 1.0


def second_run(study: Path, out: Path, workers: int) -> tuple[float, bool]:
    """Duration of the command on finished results, and whether they stayed as they were."""
    before, begin = digest_of(out), time.perf_counter()
    command = command_of("cohort", study, "--out", out, "--workers", workers)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - begin, digest_of(out) == before


def digest_of(out: Path) -> str:
    """Digest of the partitions and the comparison, by their names."""
    digest = hashlib.sha256()
    for path in [*sorted((out / "cases").glob("*.parquet")), out / "comparison.csv"]:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def command_of(*arguments: object) -> list[str]:
    return [sys.executable, *CLI, *map(str, arguments)]


def _finished(out: Path) -> int:
    """Number of finished cases of the partitions that are not complete."""
    try:
        return (out / "journal.jsonl").read_bytes().count(b"\n")
    except OSError:
        return 0


def _kill_worker(pid: int) -> int:
    """Kill a worker among the processes below ``pid``; returns how many were killed."""
    for child in psutil.Process(pid).children(recursive=True):
        try:
            # Dask's workers are the children of the command that its nanny spawned.
            if "spawn_main" in " ".join(child.cmdline()):
                child.kill()
                return 1
        except psutil.NoSuchProcess:
            continue
    return 0


def main() -> int:
    options = _options()
    with ExitStack() as stack:
        folder = options.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(exist_ok=True)
        figures = _figures(folder, options)
        left = _run_parts(folder, options, figures)
    runs = [figures["runs"][name] for name in _parts(options) if name in figures["runs"]]
    if left:
        print(f"left: {', '.join(left)}; the same command continues")
        return 1
    goals = goals_of(runs, figures["second_run_s"], unchanged=figures["unchanged"])
    cpu_s = float(np.mean([run["cpu_s_per_case"] for run in runs]))
    cost = f"a million cases: {cpu_s * 1e6 / 3600:.0f} core hours at {cpu_s:.1f} s each"
    show(goals_table(goals), cost)
    return finish(options.json, figures, goals)


def goals_of(runs: list[Run], second_s: float, *, unchanged: bool) -> list[Goal]:
    """The goals. The last run has the kills."""
    cpu_s = min(run["cpu_s_per_case"] for run in runs)
    digests = sorted({run["digest"] for run in runs})
    growths = [run["growth"] for run in runs if run["growth"] is not None]
    growth = f"{100 * max(growths):+.1f} %" if growths else "too few cases"
    whole = [run for run in runs if not run["killed"] and run["workers"] <= _processors()]
    falls = all(more["wall_s"] < fewer["wall_s"] for fewer, more in pairwise(whole))
    walls = ", ".join(f"{run['wall_s']:.0f} s with {run['workers']}" for run in whole)
    killed, again = runs[-1]["killed"], f"{second_s:.1f} s, bytes equal: {unchanged}"
    rows = (
        ("bytes of all runs:", " ".join(digests), len(digests) == 1, "equal"),
        ("killed workers:", f"{killed}", killed == KILLS, f"{KILLS}"),
        ("second run:", again, second_s < SECOND_RUN_S and unchanged,
         f"under {SECOND_RUN_S:g} s, without a change"),
        ("growth of a worker's memory:", growth, max(growths, default=0.0) <= MAX_GROWTH,
         f"at most {100 * MAX_GROWTH:g} %"),
        ("wall clock:", walls, falls, "falls with workers up to the number of processors"),
    )  # fmt: skip
    cost = at_most("processor time of a case", cpu_s, CASE_CPU_S, "s", ".1f")
    return [cost, *(Goal(*row) for row in rows)]


def _parts(options: Any) -> dict[str, tuple[int, int]]:
    """Name of each run: its number of workers, and how many of them are killed."""
    parts = {f"workers-{workers}": (workers, 0) for workers in options.workers}
    return {**parts, "killed": (max(options.workers), KILLS)}


def _run_parts(folder: Path, options: Any, figures: dict[str, Any]) -> list[str]:
    """Do the runs that are left; returns those for which the time does not suffice."""
    study, begin = folder / "study", time.monotonic()
    if not study.is_dir():
        made = ["make-case", "cohort", "-n", options.cases, "--seed", options.seed, "--out", study]
        made += ["--tracker", "aurora", "--duration", options.duration]
        if subprocess.run(command_of(*made), stdout=subprocess.DEVNULL).returncode:
            raise SystemExit("no cohort was made; expected options of marginguard make-case cohort")
    left = []
    for name, (workers, kills) in _parts(options).items():
        out = folder / name
        if name in figures["runs"]:
            print(f"{line_of(figures['runs'][name])} (earlier)")
            continue
        minutes = (time.monotonic() - begin) / 60.0 + _expected_minutes(figures, workers)
        if options.minutes is not None and minutes > options.minutes:
            left.append(name)
            continue
        if out.is_dir():
            shutil.rmtree(out)  # of a run that was interrupted: its wall clock is not known
        run = run_cohort(study, out, workers, kills=kills)
        print(line_of(run), flush=True)
        figures["runs"][name] = run
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


def _processors() -> int:
    return len(os.sched_getaffinity(0))


def _options() -> Any:
    parser = BenchParser("cohort", __doc__)
    parser.number("--cases", 12, "number of cases")
    parser.number("--workers", [1, 2], "numbers of workers")
    parser.number("--duration", 75.0, "length of a case in s")
    parser.add_argument("--seed", type=int, default=1, help="seed of the cohort (default: 1)")
    parser.add_argument("--keep", type=Path, help="folder that keeps results and finished runs")
    parser.add_argument(
        "--minutes", type=float, help="begin no run that would end later, by the runs before it"
    )
    options = parser.parse_args()
    if options.minutes is not None and options.keep is None:
        parser.error("--minutes without --keep: the runs would be lost; expected both")
    return options


if __name__ == "__main__":
    sys.exit(main())
