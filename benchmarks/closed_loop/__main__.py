"""Close the loop: a hand pushes a simulated arm towards a breathing tumour, in real time over ROS.

Separate processes: the physics with the hand (MuJoCo, 1 kHz), the tracker's driver (50 Hz, 20 ms of
latency, 0.3 mm of correlated noise), 'marginguard live' and 'marginguard control'. The hand pushes
with 10 N from random directions, without and with the fixture. The true distance is measured at
every physics step, by the product's engine and by libigl. With --stops, guard, controller and
tracker are killed and stopped in the middle of an approach instead. On a busy machine safe stops
(holds, watchdog, physics behind real time) interrupt pushes; they are counted by cause, and an
operator re-arms after them.
"""

import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.files.extras import check_installed
from app.geometry import MarginGuardError
from benchmarks.closed_loop.hand import STOP_MM
from benchmarks.harness.figures import columns_table, figures_table, load, show
from benchmarks.harness.goals import Goal, at_least, at_most, finish
from benchmarks.harness.options import BenchParser
from benchmarks.harness.processes import ChildError
from benchmarks.ros_domain import own_ros

Row = Mapping[str, Any]  # a push of `benchmarks.closed_loop.pushes.judged`


def main() -> int:
    parser = BenchParser("closed-loop", __doc__)
    parser.number("--pushes", 60, "pushes of each kind")
    kinds, text = ("with", "without", "both"), "with the fixture, without it, or both (default)"
    parser.add_argument("--kind", choices=kinds, default="both", help=text)
    parser.add_argument("--seed", type=int, default=0, help="seed of directions and tracker")
    text = "draw an error of the base's registration, by 6 landmarks with 1 mm of noise"
    parser.add_argument("--base-error", action="store_true", help=text)
    parser.add_argument("--stops", action="store_true", help="failures of processes, not pushes")
    text = "only failures of this process; once for each (default: all)"
    processes = ("guard", "tracker", "controller")
    parser.add_argument("--process", action="append", choices=processes, help=text)
    parser.add_argument("--logs", type=Path, metavar="DIR", help="keep logs and truth below DIR")
    parser.gone("--append", "--first-push", expected="all --pushes in one run")
    parser.gone("--contact", expected="pytest tests/simulation/test_contact.py")
    options = parser.parse_args()
    run = _run_stops if options.stops else _run_pushes
    try:
        check_installed("mujoco", "coacd", "rclpy", "igl")
        with own_ros(options.logs) as folder:
            from app.bridge import RosNode
            from benchmarks.closed_loop.loop_operator import Operator

            with RosNode("operator") as ros:
                rows, goals = run(options, folder, Operator(ros))
    except (MarginGuardError, ChildError) as error:
        print(f"marginguard bench closed-loop: {error}", file=sys.stderr)
        return 2
    return finish(options.json, {"rows": rows}, goals)


def _run_pushes(options: Any, folder: Path, operator: Any) -> tuple[list[Row], list[Goal]]:
    """Rows and goals of the pushes of each kind that the options ask for; shows their figures."""
    from benchmarks.closed_loop.pushes import run_pushes

    found, rows, goals = {}, [], []
    for fixture, kind in ((False, "without"), (True, "with")):
        if options.kind in ("both", kind):
            pushes, cpu = run_pushes(
                folder / kind,
                operator,
                count=options.pushes,
                seed=options.seed,
                fixture=fixture,
                base_error=options.base_error,
            )
            found[f"{kind} the fixture"] = {**summary(pushes), "cores": cpu}
            goals += goals_of(pushes, kind, options.pushes, base_error=options.base_error)
            rows += [{**each, "base_error": options.base_error} for each in pushes]
    show(figures_table(found))
    return rows, goals


def _run_stops(options: Any, folder: Path, operator: Any) -> tuple[list[Row], list[Goal]]:
    """The failures that were measured, and their goals; shows a table."""
    from benchmarks.closed_loop.stops import ALLOWED_MS, LIMITS_MS, SIGNALS, run_stop

    rows, goals = [], []
    for process in options.process or LIMITS_MS:
        for number in SIGNALS:
            name, limit_ms = f"{process}-{number.name}", LIMITS_MS[process] + ALLOWED_MS
            stop = run_stop(
                folder / name, operator, process=process, number=number, seed=options.seed
            )
            print(name, flush=True)
            found = "not measured: other stops came first"
            if stop is not None:
                rows.append(asdict(stop))
                found = "moves" if stop.still_ms is None else f"{stop.still_ms:.0f} ms"
            is_good = stop is not None and stop.is_safe
            goals.append(Goal(f"{name} stands after", found, is_good, f"at most {limit_ms:.0f} ms"))
    if rows:
        show(columns_table(f"load {load()}", rows, {name: name for name in rows[0]}, left=2))
    return rows, goals


def goals_of(
    rows: Sequence[Row], kind: str, count: int, *, base_error: bool = False
) -> Iterator[Goal]:
    """With the fixture none may be below the margin, without it every push breaches it.

    A push without the fixture that a safe stop has interrupted need not reach the tumour.
    """
    yield at_least(f"pushes {kind} the fixture:", len(rows), count)
    lowest = [min(row["lowest_mm"], row["vertices_mm"]) for row in rows]
    if kind == "with":
        limit_mm, lowest_mm = 0.0 if base_error else STOP_MM, min(lowest, default=None)
        yield at_least("with the fixture the tool keeps", lowest_mm, limit_mm, "mm", ".2f")
    else:
        free = [mm for mm, row in zip(lowest, rows, strict=True) if not row["stops"]]
        kept = sum(mm >= STOP_MM for mm in free)
        yield at_most("pushes without the fixture that keep the margin:", kept, 0)


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Figures of the pushes of one kind; speeds are of those without a safe stop."""
    free = [row for row in rows if not row["stops"]]
    return {
        "pushes": len(rows), "lowest_mm": _range(rows, "lowest_mm"),
        "vertices_mm": _range(rows, "vertices_mm"),
        "below_stop": sum(row["lowest_mm"] < STOP_MM for row in rows),
        "by_own_motion": sum(row["breach_mm"] is not None for row in rows),
        "interrupted": len(rows) - len(free),
        "stops": sum((Counter(row["stops"]) for row in rows), Counter()),
        **{name: _range(free, name) for name in ("approach_mm_s", "slide_mm_s", "retreat_mm_s")},
    }  # fmt: skip


def _range(rows: Sequence[Row], key: str) -> str:
    values = [row[key] for row in rows]
    return f"{min(values):.2f} to {max(values):.2f}" if values else ""
