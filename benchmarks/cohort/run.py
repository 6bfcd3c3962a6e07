"""One run of a cohort with the command of a user: its figures, and workers that are killed."""

import csv
import hashlib
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

from benchmarks.harness.processes import CLI

WARM_UP_CASES = 2
"""Cases of a worker before which its libraries and kernels are not all loaded."""


@dataclass(frozen=True)
class Run:
    """Figures of one run. ``growth``: the largest of the workers, None with too few cases.

    ``partitions``: number of files of the dataset. ``digest``: of their bytes and the comparison;
    wall times are in a file of their own and not part of it.
    """

    workers: int
    killed: int
    wall_s: float
    cpu_s_per_case: float
    case_wall_s: float
    rss_mb: tuple[float, float]
    growth: float | None
    digest: str
    partitions: int

    @property
    def line(self) -> str:
        """The figures in one line."""
        growth = "-" if self.growth is None else f"{100 * self.growth:+.1f} %"
        killed = f", {self.killed} killed" if self.killed else ""
        return (
            f"{self.workers} workers{killed}: {self.wall_s:.1f} s; a case "
            f"{self.cpu_s_per_case:.1f} s of processor time, {self.case_wall_s:.1f} s of wall "
            f"clock; memory of a worker {self.rss_mb[0]:.0f} to {self.rss_mb[1]:.0f} MB, growth "
            f"{growth}; {self.partitions} partitions, bytes {self.digest}"
        )


def run_cohort(study: Path, out: Path, workers: int, *, kills: int = 0) -> Run:
    """Run the cohort; kill ``kills`` workers, each after another case has finished."""
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
    return Run(
        workers,
        killed,
        wall_s,
        float(np.mean([float(row["cpu_s"]) for row in rows])),
        float(np.mean([float(row["wall_s"]) for row in rows])),
        (min(everything), max(everything)),
        max(growths, default=None),
        digest_of(out),
        len(list((out / "cases").glob("*.parquet"))),
    )


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
