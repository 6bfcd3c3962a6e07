"""Signs, distances and sweeps of the fixture against an independent oracle, over very many poses.

Twenty pairs of shapes: five tumours (convex, concave, two-part, thin shell, spiky), four tools.
Signs: surface contact by FCL, else libigl's winding number of one vertex of each part. Distances:
libigl's distance of a densely sampled tool. Sweeps: a tumour of 1 mm crossed at 1 m/s and 25 Hz.
The exit status is 1 if a sign is wrong beyond 0.05 mm of the surface, the distances are off by more
than 0.02 mm RMS or 0.1 mm, a lower bound is above the oracle's distance, or a crossing is missed.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import reduce
from multiprocessing import get_context
from operator import add
from pathlib import Path
from typing import Protocol, Self, TypeVar

from rich.console import Console

from benchmarks.fixture_agreement.crossings import Crossings, crossings
from benchmarks.fixture_agreement.distances import Distances, distances
from benchmarks.fixture_agreement.pairs import PAIRS, Pair
from benchmarks.fixture_agreement.signs import Signs, signs
from benchmarks.fixture_agreement.table import distances_table, signs_table
from benchmarks.fixture_oracle import Relation

_RMS_MM, _MAX_MM = 0.02, 0.1
_SIGNS_AT_ONCE, _DISTANCES_AT_ONCE = 5000, 250
_REPORT_INTERVAL_S = 10.0


class _Addable(Protocol):
    def __add__(self, other: Self) -> Self: ...


Part = TypeVar("Part", bound=_Addable)
Evaluate = Callable[[Pair, int, int], Part]


def over_pairs(
    pool: ProcessPoolExecutor, evaluate: Evaluate[Part], poses: int, at_once: int, what: str
) -> Iterator[dict[str, Part]]:
    """Distribute ``poses`` evenly over the pairs and the processes, and sum the results by pair.

    Yields the results so far after each pair, and prints progress to standard error.
    """
    each = -(-poses // len(PAIRS))
    tasks = [
        (pair, min(at_once, each - done), seed)
        for pair in PAIRS
        for seed, done in enumerate(range(0, each, at_once))
    ]
    found: dict[str, Part] = {}
    parts: Iterator[Part] = pool.map(evaluate, *zip(*tasks, strict=True))
    begin = last_report = time.perf_counter()
    for done, ((pair, _, _), part) in enumerate(zip(tasks, parts, strict=True), start=1):
        found[pair.name] = found[pair.name] + part if pair.name in found else part
        now = time.perf_counter()
        if done == len(tasks) or now - last_report > _REPORT_INTERVAL_S:
            last_report = now
            print(
                f"{what}: {done} of {len(tasks)} parts in {now - begin:.0f} s, "
                f"{(now - begin) * (len(tasks) / done - 1.0):.0f} s left ({pair.name})",
                file=sys.stderr,
                flush=True,
            )
        if done == len(tasks) or tasks[done][0] is not pair:
            yield found


def verdict(signed: Signs, measured: Distances, crossed: Crossings) -> dict[str, bool]:
    """Each criterion as a line of text, and whether it is met."""
    return {
        f"signs: {len(signed.wrong)} wrong of {signed.judged} evaluated ({signed.poses} poses)":
            not signed.wrong,
        f"distances over {measured.poses} poses: RMS {measured.rms_mm:.4f} mm (at most {_RMS_MM}), "
        f"max {measured.max_mm:.4f} mm (at most {_MAX_MM})":
            measured.rms_mm <= _RMS_MM and measured.max_mm <= _MAX_MM,
        f"lower bounds above the oracle's distance: {measured.above_bound} of {measured.poses}":
            measured.above_bound == 0,
        f"crossings detected by a sweep: {crossed.caught} of {crossed.count}, "
        f"{crossed.confirmed} of them confirmed by the oracle":
            crossed.count == crossed.caught == crossed.confirmed,
    }  # fmt: skip


def document(
    signed: dict[str, Signs], measured: dict[str, Distances], crossed: Crossings | None
) -> dict[str, object]:
    """Plain values for a JSON file, the poses of wrong signs included."""
    return {
        "signs": {
            name: {
                "poses": row.poses, "judged": row.judged, "within_half_mm": row.grazing,
                **{relation.name.lower(): row.relations[relation] for relation in Relation},
                "wrong": [pose.tolist() for pose in row.wrong],
            }
            for name, row in signed.items()
        },
        "distances": {
            name: {
                "poses": row.poses, "rms_mm": row.rms_mm, "max_mm": row.max_mm,
                "above_bound": row.above_bound,
            }
            for name, row in measured.items()
        },
        "crossings": crossed and asdict(crossed),
    }  # fmt: skip


def write(path: Path | None, figures: dict[str, object]) -> None:
    """Write to a temporary file and rename it, so that the file is complete at any time."""
    if path is None:
        return
    partial_file = path.with_name(f"{path.name}.part")
    partial_file.write_text(json.dumps(figures, indent=1) + "\n")
    partial_file.replace(path)


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="marginguard bench fixture-agreement",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for name, count in (("signs", 1_000_000), ("distances", 20_000), ("crossings", 1000)):
        parser.add_argument(
            f"--{name}", type=int, default=count, metavar="COUNT", help=f"(default: {count})"
        )
    parser.add_argument(
        "--processes", type=int, default=2, help="number of parallel processes (default: 2)"
    )
    parser.add_argument(
        "--json",
        type=Path,
        metavar="FILE",
        help="also write the figures there, after each pair those so far without a verdict",
    )
    options = parser.parse_args()
    for name in ("signs", "distances", "crossings", "processes"):
        if (count := getattr(options, name)) < 1:
            parser.error(f"--{name} is {count}; expected at least 1")
    return options


def main() -> int:
    options = parsed()
    console = Console(width=None if sys.stdout.isatty() else 130)
    signs(PAIRS[0], 1, 0)  # compile the kernels before the processes start
    signed: dict[str, Signs] = {}
    measured: dict[str, Distances] = {}
    with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as pool:
        for signed in over_pairs(pool, signs, options.signs, _SIGNS_AT_ONCE, "signs"):
            write(options.json, document(signed, measured, None))
        console.print(signs_table(signed))
        parts = over_pairs(pool, distances, options.distances, _DISTANCES_AT_ONCE, "distances")
        for measured in parts:
            write(options.json, document(signed, measured, None))
        console.print(distances_table(measured))
    crossed = crossings(options.crossings)
    lines = verdict(reduce(add, signed.values()), reduce(add, measured.values()), crossed)
    for line, good in lines.items():
        console.print("[green]ok  [/]" if good else "[bold red]MISS[/]", line, highlight=False)
    write(options.json, document(signed, measured, crossed) | {"verdict": lines})
    return int(not all(lines.values()))


if __name__ == "__main__":
    sys.exit(main())
