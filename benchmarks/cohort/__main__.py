"""A simulated cohort with 1, 2 and more workers: wall clock, memory of each worker, equal bytes.

Each number of workers runs the whole cohort into a folder of its own, with the command of a user.
Then the same command runs again, which has nothing to do, and the cohort runs once more while two
workers are killed. Cases are made by the workers and not stored.
"""

import csv
import hashlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.harness.figures import figures_table, show
from benchmarks.harness.goals import Goal, at_most, finish
from benchmarks.harness.options import BenchParser
from benchmarks.harness.processes import CLI

CASE_CPU_S = 3.0
SECOND_RUN_S = 10.0
MAX_GROWTH = 0.05  # of a worker's memory, last over first quarter of its cases after the warm-up
WARM_UP_CASES = 2  # cases of a worker before which its libraries and kernels are not all loaded
KILLS = 2

Run = Mapping[str, Any]  # figures of one run: those of `run_cohort`


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
    with tempfile.TemporaryDirectory() as folder:
        figures = _measured(Path(folder), options)
    runs = figures["runs"]
    cpu_s = float(np.mean([run["cpu_s_per_case"] for run in runs]))
    show(f"a million cases: {cpu_s * 1e6 / 3600:.0f} core hours at {cpu_s:.1f} s each")
    goals = goals_of(runs, figures["second_run_s"], unchanged=figures["unchanged"])
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


def _measured(folder: Path, options: Any) -> dict[str, Any]:
    """Figures of a run with each number of workers, of a second run, and of one with kills."""
    study, runs = folder / "study", []
    made = ["make-case", "cohort", "-n", options.cases, "--seed", options.seed, "--out", study]
    made += ["--tracker", "aurora", "--duration", options.duration]
    if subprocess.run(command_of(*made), stdout=subprocess.DEVNULL).returncode:
        raise SystemExit("no cohort was made; expected options of marginguard make-case cohort")
    for workers, kills in (*((each, 0) for each in options.workers), (max(options.workers), KILLS)):
        out = folder / f"{workers}-{kills}"
        runs.append(run_cohort(study, out, workers, kills=kills))
        show(figures_table(runs[-1]))
    workers = options.workers[-1]
    second_s, unchanged = second_run(study, folder / f"{workers}-0", workers)
    return {
        "cases": options.cases,
        "duration_s": options.duration,
        "seed": options.seed,
        "runs": runs,
        "second_run_s": second_s,
        "unchanged": unchanged,
    }


def _processors() -> int:
    return len(os.sched_getaffinity(0))


def _options() -> Any:
    parser = BenchParser("cohort", __doc__)
    parser.number("--cases", 12, "number of cases")
    parser.number("--workers", [1, 2], "numbers of workers")
    parser.number("--duration", 75.0, "length of a case in s")
    parser.add_argument("--seed", type=int, default=1, help="seed of the cohort (default: 1)")
    parser.gone("--keep", "--minutes", "--scratch", expected="all --workers in one run")
    return parser.parse_args()
