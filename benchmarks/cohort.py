"""A simulated cohort with 1, 2 and more workers: wall clock, memory of each worker, equal bytes.

Each number of workers runs the whole cohort into a folder of its own, with the command of a user.
Then the same command runs again, which has nothing to do, and the cohort runs once more while two
workers are killed. Cases are made by the workers and not stored. Takes about 6 s of processor time
for each case and number of workers. Exit status: 1 when a goal is missed.
"""

import argparse
import csv
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import psutil

SECOND_RUN_S = 10.0
MAX_GROWTH = 0.05
"""Share by which a worker's memory may be higher in the second half of its cases."""
WARM_UP_CASES = 2
"""Cases of a worker before which its libraries and kernels are not all loaded."""
KILLS = 2


@dataclass(frozen=True)
class Run:
    """Figures of one run. ``growth``: the largest of the workers, None with too few cases."""

    workers: int
    killed: int
    wall_s: float
    cpu_s_per_case: float
    case_wall_s: float
    rss_mb: tuple[float, float]
    growth: float | None
    digest: str


def main() -> int:
    """Run the benchmark and print its figures."""
    options = _options()
    missed = []
    with tempfile.TemporaryDirectory(dir=options.scratch, prefix="bench-cohort-") as temporary:
        folder = Path(temporary)
        study = folder / "study"
        made = ["make-cohort", "-n", options.cases, "--seed", options.seed, "--out", study]
        made += ["--tracker", "aurora", "--duration", options.duration]
        subprocess.run(_command(*made), check=True, stdout=subprocess.DEVNULL)
        runs = []
        for workers in options.workers:
            runs.append(_run(study, folder / f"workers-{workers}", workers))
            print(_line(runs[-1]), flush=True)
        last = folder / f"workers-{options.workers[-1]}"
        second_s, again = _second_run(study, last, options.workers[-1])
        print(f"second run: {second_s:.1f} s (goal {SECOND_RUN_S:g} s), bytes equal: {again}")
        runs.append(_run(study, folder / "killed", max(options.workers), kills=KILLS))
        print(_line(runs[-1]), flush=True)
    missed += _missed(runs, second_s, unchanged=again)
    cpu_s = float(np.mean([run.cpu_s_per_case for run in runs]))
    print(f"a million cases: {cpu_s * 1e6 / 3600:.0f} core hours at {cpu_s:.1f} s each")
    print("\n".join(f"missed: {text}" for text in missed) or "all goals met")
    if options.json is not None:
        figures = {"runs": [asdict(run) for run in runs], "second_run_s": second_s}
        options.json.write_text(json.dumps({**figures, "missed": missed}, indent=2) + "\n")
    return 1 if missed else 0


def _run(study: Path, out: Path, workers: int, *, kills: int = 0) -> Run:
    """Run the cohort; kill ``kills`` workers, each after another case has finished."""
    begin = time.perf_counter()
    command = _command("cohort", study, "--out", out, "--workers", workers)
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
    growths = [g for values in memory.values() if (g := _growth(values)) is not None]
    return Run(
        workers,
        killed,
        wall_s,
        float(np.mean([float(row["cpu_s"]) for row in rows])),
        float(np.mean([float(row["wall_s"]) for row in rows])),
        (min(everything), max(everything)),
        max(growths, default=None),
        _digest(out),
    )


def _growth(values: list[float]) -> float | None:
    """Memory in the second half of a worker's cases, relative to the first; None of too few."""
    warm = values[WARM_UP_CASES:]
    if len(warm) < 2:
        return None
    half = len(warm) // 2
    return float(np.mean(warm[half:]) / np.mean(warm[:half])) - 1.0


def _second_run(study: Path, out: Path, workers: int) -> tuple[float, bool]:
    """Duration of the command on finished results, and whether they stayed as they were."""
    before, begin = _digest(out), time.perf_counter()
    command = _command("cohort", study, "--out", out, "--workers", workers)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - begin, _digest(out) == before


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


def _digest(out: Path) -> str:
    """Digest of the partitions and the comparison, by their names."""
    digest = hashlib.sha256()
    for path in [*sorted((out / "cases").glob("*.parquet")), out / "comparison.csv"]:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _missed(runs: list[Run], second_s: float, *, unchanged: bool) -> list[str]:
    missed = []
    if len({run.digest for run in runs}) > 1:
        missed.append(f"bytes differ: {[(run.workers, run.digest) for run in runs]}")
    if second_s > SECOND_RUN_S or not unchanged:
        missed.append(f"second run took {second_s:.1f} s, bytes equal: {unchanged}")
    missed += [
        f"memory of {run.workers} workers grew by {100 * run.growth:.1f} %"
        for run in runs
        if run.growth is not None and run.growth > MAX_GROWTH
    ]
    whole = [run for run in runs if not run.killed and run.workers <= _processors()]
    for fewer, more in pairwise(whole):
        if more.wall_s >= fewer.wall_s:
            missed.append(f"{more.workers} workers took longer than {fewer.workers}")
    if runs[-1].killed < KILLS:
        missed.append(f"{runs[-1].killed} workers were killed; expected {KILLS}")
    return missed


def _line(run: Run) -> str:
    growth = "-" if run.growth is None else f"{100 * run.growth:+.1f} %"
    killed = f", {run.killed} killed" if run.killed else ""
    return (
        f"{run.workers} workers{killed}: {run.wall_s:.1f} s; a case {run.cpu_s_per_case:.1f} s of "
        f"processor time, {run.case_wall_s:.1f} s of wall clock; memory of a worker "
        f"{run.rss_mb[0]:.0f} to {run.rss_mb[1]:.0f} MB, growth {growth}; bytes {run.digest}"
    )


def _command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "app.cli", *map(str, arguments)]


def _processors() -> int:
    return len(os.sched_getaffinity(0))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="marginguard bench cohort",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--cases", type=_positive, default=12, help="number of cases (12)")
    parser.add_argument(
        "--workers", type=_positive, nargs="+", default=[1, 2], help="numbers of workers (1 2)"
    )
    parser.add_argument("--duration", type=float, default=75.0, help="length of a case in s (75)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the cohort (1)")
    parser.add_argument("--scratch", type=Path, help="existing folder for the results")
    parser.add_argument("--json", type=Path, help="write the figures there too")
    options = parser.parse_args()
    if options.scratch is not None and not options.scratch.is_dir():
        parser.error(f"--scratch {options.scratch}: no such folder; expected an existing one")
    return options


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; expected 1 or more")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
