"""Close the loop: a hand pushes a simulated arm towards a breathing tumour, in real time over ROS.

    marginguard bench closed-loop [--pushes N] [--first-push K] [--stops] [--json FILE [--append]]

Separate processes: the physics with the hand (MuJoCo, 1 kHz), the tracker's driver (50 Hz, 20 ms of
latency, 0.3 mm of correlated noise), 'marginguard live' and 'marginguard control'. The hand pushes
with 10 N from random directions, without and with the fixture. The true distance is measured at
every physics step, by the product's engine and by libigl. With --stops, guard, controller and
tracker are killed and stopped in the middle of an approach instead. On a busy machine safe stops
(holds, watchdog, physics behind real time) interrupt pushes; they are counted by cause, and an
operator re-arms after them. With --first-push and --append a run of many pushes is made in parts,
and the figures are those of all rows of FILE.

Exit status 1 if the true distance of a push with the fixture is ever below the stop margin (with
--base-error: below 0), if a push without it does not breach the margin, if an arm did not stand in
time after a failure; 2 if a process cannot run.
"""

import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.files.extras import check_installed
from app.geometry import InputError, MarginGuardError
from benchmarks.closed_loop.hand import STOP_MM
from benchmarks.harness.figures import load, show, table, write_json
from benchmarks.harness.options import BenchParser
from benchmarks.harness.processes import ChildError
from benchmarks.ros_domain import own_ros

_KEYS = ("fixture", "number", "lowest_mm", "vertices_mm", "breach_mm", "stops")
_SPEEDS = {"approach": "approach_mm_s", "sliding": "slide_mm_s", "retreat": "retreat_mm_s"}

Row = Mapping[str, Any]  # a push of `benchmarks.closed_loop.pushes.judged`


def parsed(arguments: Sequence[str] | None) -> Any:
    parser = BenchParser("closed-loop", __doc__)
    parser.number("--pushes", 60, "pushes of each kind")
    first = "number of the first push, which with the seed gives its direction"
    parser.number("--first-push", 0, first, low=0, metavar="K")
    parser.add_argument(
        "--kind",
        choices=("with", "without", "both"),
        default="both",
        help="pushes with the fixture, without it, or both (default)",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of directions and tracker")
    parser.add_argument(
        "--base-error",
        action="store_true",
        help="an error of the registration of the base in the controller, drawn for each run "
        "inside the covariance that 6 landmarks with 1 mm of noise predict",
    )
    parser.add_argument(
        "--stops", action="store_true", help="the table of failures instead of pushes"
    )
    parser.add_argument(
        "--process",
        action="append",
        choices=("guard", "tracker", "controller"),
        help="only failures of this process; once for each (default: all)",
    )
    parser.add_argument(
        "--append", action="store_true", help="add the pushes to those in FILE of an earlier run"
    )
    parser.add_argument(
        "--logs", type=Path, metavar="DIR", help="keep the logs and the truth below DIR"
    )
    options = parser.parse_args(arguments)
    if options.append and (options.json is None or options.stops):
        parser.error("--append needs --json FILE and pushes; expected both")
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    options = parsed(arguments)
    try:
        check_installed("mujoco", "coacd", "rclpy", "igl")
        earlier = read_rows(options.json) if options.append else []
        with own_ros(options.logs) as folder:
            from app.bridge import RosNode
            from benchmarks.closed_loop.loop_operator import Operator

            with RosNode("operator") as ros:
                if options.stops:
                    rows, is_good = _run_stops(options, folder, Operator(ros))
                else:
                    rows = merged(earlier, _run_pushes(options, folder, Operator(ros)))
                    is_good = _print_pushes(rows, options)
    except (MarginGuardError, ChildError) as error:
        print(f"marginguard bench closed-loop: {error}", file=sys.stderr)
        return 2
    write_json(options.json, {"rows": rows})
    return 0 if is_good else 1


def _run_pushes(options: Any, folder: Path, operator: Any) -> list[dict[str, Any]]:
    """Rows of the pushes of each kind that the options ask for; prints processor times."""
    from benchmarks.closed_loop.pushes import run_pushes

    rows = []
    for fixture in (False, True):
        if options.kind != "both" and fixture is not (options.kind == "with"):
            continue
        pushes, cpu = run_pushes(
            folder / str(fixture),
            operator,
            count=options.pushes,
            first=options.first_push,
            seed=options.seed,
            fixture=fixture,
            base_error=options.base_error,
        )
        shares = ", ".join(f"{name} {share:.2f}" for name, share in cpu.items())
        print(f"processor time per time, 1 is a core: {shares}; load {load():.1f}")
        rows += [{**each, "base_error": options.base_error} for each in pushes]
    return rows


def _print_pushes(rows: Sequence[Row], options: Any) -> bool:
    """Print the figures of all rows; true if the fixture kept all of its own and no other was kept.

    A push without the fixture that a safe stop has interrupted need not reach the tumour.
    """
    limit_mm = 0.0 if options.base_error else STOP_MM
    is_good = bool(rows)
    for fixture in (False, True):
        own = [each for each in rows if each["fixture"] is fixture]
        if own:
            print("\n".join(lines_of(own, fixture)))
        for each in own:
            lowest_mm = min(each["lowest_mm"], each["vertices_mm"])
            kept = lowest_mm >= (limit_mm if fixture else STOP_MM)
            is_good = is_good and (kept is fixture or (not fixture and bool(each["stops"])))
    return is_good and len(rows) >= options.pushes * (2 if options.kind == "both" else 1)


def _run_stops(options: Any, folder: Path, operator: Any) -> tuple[list[dict[str, Any]], bool]:
    """The failures; true if all were measured and the arm stood in time. Prints their table."""
    from benchmarks.closed_loop.stops import LIMITS_MS, SIGNALS, run_stop

    cells: list[Sequence[object]] = []
    found = []
    is_good = True
    for process in options.process or LIMITS_MS:
        for number in SIGNALS:
            name = f"{process}-{number.name}"
            row = run_stop(
                folder / name, operator, process=process, number=number, seed=options.seed
            )
            print(name, flush=True)
            is_good = is_good and row is not None and row.is_safe
            if row is not None:
                found.append(asdict(row))
            cells.append(
                (name, "not measured: other stops came first") if row is None else row.cells
            )
    headings = ("failure", "before", "below 1 mm/s after", "limit", "lowest", "after it goes on")
    show(table(f"load {load():.1f}", headings, cells))
    return found, is_good


def read_rows(path: Path) -> list[dict[str, Any]]:
    """The rows in the file of an earlier run; empty without the file. Raises `InputError`."""
    if not path.exists():
        return []
    try:
        rows: list[dict[str, Any]] = json.loads(path.read_text())["rows"]
        for row in rows:
            for name in _KEYS:
                row[name]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: {error!r}; expected the rows of an earlier run") from error
    return rows


def merged(earlier: Sequence[Row], later: Sequence[Row]) -> list[dict[str, Any]]:
    """Both, ordered; of two rows of one push the later counts."""
    found = {(row["fixture"], row["number"]): dict(row) for row in (*earlier, *later)}
    return [found[key] for key in sorted(found)]


def lines_of(rows: Sequence[Row], fixture: bool) -> list[str]:
    """Lines that summarise the rows of one kind, at least one."""
    lowest = sorted(row["lowest_mm"] for row in rows)
    vertices = [row["vertices_mm"] for row in rows]
    free = [row for row in rows if not row["stops"]]
    driven = sum(row["breach_mm"] is not None for row in rows)
    stops = sum((Counter(row["stops"]) for row in rows), Counter())
    lines = [
        f"{'with' if fixture else 'without'} the fixture: {len(rows)} pushes, lowest true distance "
        f"{lowest[0]:.2f} to {lowest[-1]:.2f} mm, {sum(each < STOP_MM for each in lowest)} below "
        f"{STOP_MM:g} mm, {driven} of them by the tool's own motion; {len(rows) - len(free)} "
        "pushes with a safe stop",
        f"  by libigl at every step: {min(vertices):.2f} to {max(vertices):.2f} mm",
    ]
    if stops:
        causes = ", ".join(f"{cause} {count}" for cause, count in sorted(stops.items()))
        lines.append(f"  safe stops: {causes}")
    if free:
        lines.append(
            "  without a stop: "
            + ", ".join(f"{name} {_range(free, key)} mm/s" for name, key in _SPEEDS.items())
        )
    return lines


def _range(rows: Sequence[Row], key: str) -> str:
    values = [row[key] for row in rows]
    return f"{min(values):.0f} to {max(values):.0f}"


if __name__ == "__main__":
    sys.exit(main())
