"""Signs, distances and sweeps of the fixture against an independent judge, over very many poses.

Twenty pairs of shapes: five tumours (convex, concave, two-part, thin shell, spiky), four tools.
Signs: surface contact by FCL, else libigl's winding number of one vertex of each part. Distances:
libigl's distance of a densely sampled tool. Sweeps: a tumour of 1 mm crossed at 1 m/s and 25 Hz.
Exit status 1 when a sign is wrong beyond 0.05 mm of the surface, a distance is off by more than
0.02 mm RMS or 0.1 mm, a lower bound is above the judge's distance, or a crossing is not caught.
"""

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import reduce
from multiprocessing import get_context
from operator import add
from pathlib import Path
from typing import Protocol, Self, TypeVar

from rich.console import Console

from app.cli.progress import with_progress
from benchmarks.fixture_agreement.crossings import Crossings, crossings
from benchmarks.fixture_agreement.distances import Distances, distances
from benchmarks.fixture_agreement.pairs import PAIRS, Pair
from benchmarks.fixture_agreement.signs import Signs, signs
from benchmarks.fixture_agreement.table import distances_table, signs_table
from benchmarks.fixture_oracle import Relation

_RMS_MM, _MAX_MM = 0.02, 0.1
_SIGNS_AT_ONCE, _DISTANCES_AT_ONCE = 5000, 250


class _Addable(Protocol):
    def __add__(self, other: Self) -> Self: ...


Part = TypeVar("Part", bound=_Addable)
Judge = Callable[[Pair, int, int], Part]


def over_pairs(
    pool: ProcessPoolExecutor, judge: Judge[Part], poses: int, at_once: int, what: str
) -> dict[str, Part]:
    """Spread ``poses`` evenly over the pairs and over the workers, and add up by pair."""
    each = -(-poses // len(PAIRS))
    tasks = [
        (pair, min(at_once, each - done), seed)
        for pair in PAIRS
        for seed, done in enumerate(range(0, each, at_once))
    ]
    found: dict[str, list[Part]] = {pair.name: [] for pair in PAIRS}
    parts: Iterator[Part] = pool.map(judge, *zip(*tasks, strict=True))
    for (pair, _, _), part in zip(
        tasks, with_progress(parts, f"{what}, of {len(tasks)} parts:"), strict=True
    ):
        found[pair.name].append(part)
    return {name: reduce(add, held) for name, held in found.items()}


def verdict(signed: Signs, measured: Distances, crossed: Crossings) -> dict[str, bool]:
    """What is asked for in a line each, and whether it holds."""
    return {
        f"signs: {len(signed.wrong)} wrong of {signed.judged} judged ({signed.poses} poses)":
            not signed.wrong,
        f"distances over {measured.poses} poses: RMS {measured.rms_mm:.4f} mm (at most {_RMS_MM}), "
        f"max {measured.max_mm:.4f} mm (at most {_MAX_MM})":
            measured.rms_mm <= _RMS_MM and measured.max_mm <= _MAX_MM,
        f"lower bounds above the judge's distance: {measured.above_bound} of {measured.poses}":
            measured.above_bound == 0,
        f"crossings caught by a sweep: {crossed.caught} of {crossed.count}, "
        f"{crossed.confirmed} of them confirmed by the judge":
            crossed.count == crossed.caught == crossed.confirmed,
    }  # fmt: skip


def document(
    signed: dict[str, Signs], measured: dict[str, Distances], crossed: Crossings
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
        "crossings": {
            "count": crossed.count, "caught": crossed.caught, "confirmed": crossed.confirmed
        },
    }  # fmt: skip


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
    parser.add_argument("--workers", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    options = parser.parse_args()
    if min(options.signs, options.distances, options.crossings, options.workers) < 1:
        parser.error("counts of 1 and more are wanted")
    return options


def main() -> int:
    options = parsed()
    console = Console(width=None if sys.stdout.isatty() else 130)
    signs(PAIRS[0], 1, 0)  # so that the workers find the kernels compiled
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        signed = over_pairs(pool, signs, options.signs, _SIGNS_AT_ONCE, "signs")
        console.print(signs_table(signed))
        measured = over_pairs(pool, distances, options.distances, _DISTANCES_AT_ONCE, "distances")
        console.print(distances_table(measured))
    crossed = crossings(options.crossings)
    lines = verdict(reduce(add, signed.values()), reduce(add, measured.values()), crossed)
    for line, good in lines.items():
        console.print("[green]ok  [/]" if good else "[bold red]MISS[/]", line, highlight=False)
    if options.json is not None:
        text = json.dumps(document(signed, measured, crossed) | {"verdict": lines}, indent=1)
        options.json.write_text(text + "\n")
    return int(not all(lines.values()))


if __name__ == "__main__":
    sys.exit(main())
