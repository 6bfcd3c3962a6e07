"""Simulated hand that pushes with 10 N towards the tumour, with and without the fixture.

    marginguard bench push [--directions 200] [--json FILE] [--plot FILE]

Random directions, a still and a breathing tumour (amplitude 5 mm, 0.25 Hz), the robot controlled at
1 kHz by its encoders, the tumour tracked at 50 Hz with a delay of 20 ms and a jitter of 0.3 mm per
axis. The exit status is 1 if the true distance is more than 0.2 mm below the stop margin, a limit
cycle is larger than 0.05 mm, a retreat is slowed, or a push without the fixture does not penetrate.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from app.cli.progress import with_progress
from app.fixture import MarginState, ProximityEngine
from app.geometry import FloatArray
from benchmarks.fixture_oracle import Oracle
from benchmarks.fixture_shapes import cautery, lobed_tumor
from benchmarks.push_plot import write_plot
from benchmarks.push_simulation import MARGINS, Push, PushResult, Tracker, simulate

ALLOWED_BELOW_MM = 0.2
ALLOWED_CYCLE_MM = 0.05
ALLOWED_SLOWER_MM_S = 1e-6

QUIET = "still, no jitter"
_STILL = Push(seed=0, fixture=True, swing_mm=0.0, push_s=0.55)
SCENES = {
    "still": _STILL,
    "breathing": replace(_STILL, swing_mm=5.0, push_s=1.2),
    # Without jitter, any oscillation comes from the control loop. Every fourth direction only.
    QUIET: replace(
        _STILL, push_s=1.4, pull_s=0.0, tracker=Tracker(jitter_mm=1e-4, jitter_rad=1e-6)
    ),
}
_TUMOR, _TOOL = lobed_tumor(5000), cautery(800)


@dataclass(frozen=True, slots=True)
class Outcome:
    """The figures of one push. ``series`` (n, 3): time in s, true distance in mm, state.

    ``oracle_mm``: the lowest distance by libigl on a dense sample of the tool. ``cycle_mm``: the
    limit cycle of the settled distances (`cycle_mm`).
    """

    series: FloatArray
    lowest_mm: float
    oracle_mm: float
    settled_mm: float
    cycle_mm: float
    top_speed_mm_s: float
    retreats: int
    slowed_mm_s: float
    pull_lag_mm: float


class PushBench:
    """The engines of one process, built once."""

    def __init__(self) -> None:
        self._engine, self._truth = (ProximityEngine(_TUMOR, _TOOL) for _ in range(2))
        self._oracle = Oracle.of(_TUMOR, _TOOL)

    def outcome(self, push: Push) -> Outcome:
        """Simulate a push and compute its figures."""
        pushed = simulate(push, self._engine, self._truth)
        if pushed.lowest is None:
            raise RuntimeError(f"push {push.seed}: has no measurement; expected at least one")
        settled = np.array(pushed.settled_mm)
        return Outcome(
            series=_series(pushed),
            lowest_mm=min(pushed.distance_mm),
            oracle_mm=self._oracle.signed_distance_mm(pushed.lowest),
            settled_mm=float(settled.mean()),
            cycle_mm=cycle_mm(settled),
            top_speed_mm_s=pushed.top_speed_mm_s,
            retreats=pushed.retreats,
            slowed_mm_s=pushed.slowed_mm_s,
            pull_lag_mm=pushed.pull_lag_mm,
        )


_bench: list[PushBench] = []


def _outcome(push: Push) -> Outcome:
    if not _bench:
        _bench.append(PushBench())
    return _bench[0].outcome(push)


def cycle_mm(distances_mm: FloatArray) -> float:
    """Half the peak-to-peak deviation of distances (n,) from a fitted straight line."""
    place = np.arange(len(distances_mm))
    line = np.polyval(np.polyfit(place, distances_mm, 1), place)
    return 0.5 * float(np.ptp(distances_mm - line))


def summary(outcomes: Iterable[Outcome]) -> dict[str, float]:
    """The figures of one scene: the worst of its pushes, a mean, a median or a sum, as named."""
    table = list(outcomes)
    return {
        "pushes": len(table),
        "lowest_minus_stop_mm": min(each.lowest_mm for each in table) - MARGINS.stop_mm,
        "highest_low_minus_stop_mm": max(each.lowest_mm for each in table) - MARGINS.stop_mm,
        "settled_mean_mm": float(np.mean([each.settled_mm for each in table])),
        "cycle_median_mm": float(np.median([each.cycle_mm for each in table])),
        "cycle_max_mm": max(each.cycle_mm for each in table),
        "top_speed_mm_s": max(each.top_speed_mm_s for each in table),
        "retreats": sum(each.retreats for each in table),
        "slowed_mm_s": max(each.slowed_mm_s for each in table),
        "pull_lag_mm": max(each.pull_lag_mm for each in table),
        "oracle_differs_mm": max(abs(each.oracle_mm - each.lowest_mm) for each in table),
    }


def faults(figures: dict[str, dict[str, float]]) -> list[str]:
    """The criteria that are not met, as text."""
    found = []
    for name, row in figures.items():
        if name.endswith("fixture off"):
            if row["highest_low_minus_stop_mm"] >= -MARGINS.stop_mm:
                found.append(f"{name}: a push does not penetrate")
            continue
        if row["lowest_minus_stop_mm"] < -ALLOWED_BELOW_MM:
            found.append(f"{name}: {-row['lowest_minus_stop_mm']:.3f} mm below the stop margin")
        if row["slowed_mm_s"] > ALLOWED_SLOWER_MM_S:
            found.append(f"{name}: a retreat is slowed")
        if name.startswith(QUIET) and row["cycle_max_mm"] > ALLOWED_CYCLE_MM:
            found.append(f"{name}: a limit cycle of {row['cycle_max_mm']:.3f} mm")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="marginguard bench push", description=__doc__.split("\n\n")[0]
    )
    parser.add_argument(
        "--directions", type=int, default=200, help="number of pushes (default: 200)"
    )
    parser.add_argument(
        "--processes",
        type=int,
        default=min(2, os.cpu_count() or 1),
        help="number of parallel processes",
    )
    parser.add_argument(
        "--registration-mm", type=float, default=0.0, help="registration sigma per axis"
    )
    parser.add_argument(
        "--no-recent", action="store_true", help="without recent witnesses, for comparison"
    )
    parser.add_argument("--json", type=Path, help="also write the figures there")
    parser.add_argument("--plot", type=Path, help="plot the distances over time there")
    options = parser.parse_args()
    if options.directions < 1:
        parser.error(f"--directions is {options.directions}; expected at least 1")
    begin = time.perf_counter()
    outcomes: dict[str, list[Outcome]] = {}
    with ProcessPoolExecutor(options.processes) as pool:
        for scene, push in SCENES.items():
            for fixture in (True, False) if push.pull_s > 0.0 else (True,):
                pushes = [
                    replace(
                        push,
                        seed=seed,
                        fixture=fixture,
                        registration_mm=options.registration_mm,
                        recent=not options.no_recent,
                    )
                    for seed in range(0, options.directions, 4 if scene == QUIET else 1)
                ]
                name = f"{scene}, fixture {'on' if fixture else 'off'}"
                pushed = pool.map(_outcome, pushes, chunksize=4)
                outcomes[name] = list(with_progress(pushed, name, total=len(pushes)))
                _print(name, summary(outcomes[name]))
    figures = {name: summary(table) for name, table in outcomes.items()}
    wrong = faults(figures)
    print(f"{time.perf_counter() - begin:.0f} s; " + ("; ".join(wrong) or "all criteria met"))
    if options.json is not None:
        report = {"directions": options.directions, "scenes": figures, "faults": wrong}
        options.json.write_text(json.dumps(report, indent=1) + "\n")
    if options.plot is not None:
        columns = [
            (
                title,
                [each.series for each in outcomes[f"{scene}, fixture on"]],
                [each.series for each in outcomes[f"{scene}, fixture off"]],
            )
            for scene, title in (
                ("still", f"{options.directions} directions, tumour still"),
                ("breathing", "tumour breathing, 5 mm to both sides at 0.25 Hz"),
            )
        ]
        write_plot(options.plot, columns)
    sys.exit(1 if wrong else 0)


def _print(name: str, row: dict[str, float]) -> None:
    print(
        f"{name:<32} lowest - stop {row['lowest_minus_stop_mm']:+7.3f} mm   "
        f"settled {row['settled_mean_mm']:6.2f}   cycle p50 {row['cycle_median_mm']:.4f} "
        f"max {row['cycle_max_mm']:.4f}   top {row['top_speed_mm_s']:.0f} mm/s   "
        f"slowed {row['slowed_mm_s']:.1e} mm/s, {row['pull_lag_mm']:.1e} mm "
        f"({row['retreats']:.0f})   oracle {row['oracle_differs_mm']:.4f}",
        flush=True,
    )


def _series(pushed: PushResult) -> FloatArray:
    """Every second measurement, which suffices for a plot."""
    states = pushed.state or [MarginState.UNKNOWN] * len(pushed.seconds)
    return np.column_stack([pushed.seconds, pushed.distance_mm, states])[::2]


if __name__ == "__main__":
    main()
