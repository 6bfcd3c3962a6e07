"""Close the loop: a hand pushes a simulated arm towards a breathing tumour, in real time over ROS.

    marginguard bench closed-loop [--pushes N] [--stops] [--json FILE]

Separate processes: the physics with the hand (MuJoCo, 1 kHz), the tracker's driver (50 Hz, 20 ms of
latency, 0.3 mm of correlated noise), 'marginguard live' and 'marginguard control'. The hand pushes
with 10 N from random directions, without and with the fixture. The true distance is measured at
every physics step. With --stops, guard, controller and tracker are killed and stopped in the middle
of an approach instead. On a busy machine safe stops (holds, watchdog, physics behind real time)
interrupt pushes; they are counted apart from breaches, and an operator re-arms after them. A breach
is a distance below the stop margin that the tool's own motion reduces: the tumour also breathes
towards a tool that stands.

Exit status 1 if a push with the fixture breaches the stop margin, if one without it does not breach
the margin, or if an arm did not stand in time after a failure; 2 if a process cannot run.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.files.extras import check_installed
from app.geometry import MarginGuardError
from benchmarks.faults.child import ChildError
from benchmarks.ros_domain import reserved_domain

if TYPE_CHECKING:
    from benchmarks.closed_loop.loop_operator import Operator
    from benchmarks.closed_loop.pushes import Push

STOP_MM = 1.0
"""``stop_mm`` of the shipped live.yaml."""


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(
        prog="marginguard bench closed-loop",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--pushes", type=int, default=60, help="pushes of each kind (default: 60)")
    parser.add_argument("--seed", type=int, default=0, help="seed of directions and tracker")
    parser.add_argument(
        "--base-error",
        action="store_true",
        help="an error of 1 degree and 2 mm of the registration of the base in the controller",
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
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to FILE")
    options = parser.parse_args(arguments)
    if options.pushes < 1:
        parser.error(f"--pushes is {options.pushes}; expected at least 1")
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; return its exit status."""
    options = parsed(arguments)
    try:
        check_installed("mujoco", "coacd", "rclpy", "igl")
        with reserved_domain() as domain, tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            _prepare(domain, folder)
            from app.bridge import RosNode
            from benchmarks.closed_loop.loop_operator import Operator

            with RosNode("operator", domain_id=domain) as ros:
                run = _run_stops if options.stops else _run_pushes
                found, is_good = run(options, folder, Operator(ros))
    except (MarginGuardError, ChildError) as error:
        print(f"marginguard bench closed-loop: {error}", file=sys.stderr)
        return 2
    if options.json is not None:
        values = [asdict(each) for each in found]
        options.json.write_text(json.dumps({"load": os.getloadavg(), "rows": values}, indent=2))
    return 0 if is_good else 1


def _prepare(domain: int, folder: Path) -> None:
    from benchmarks.faults.environment import prepare

    prepare(domain, folder)


def _run_pushes(
    options: argparse.Namespace, folder: Path, operator: "Operator"
) -> tuple[list[Any], bool]:
    """The pushes of both kinds; true if the fixture kept all of its own and no other was kept."""
    from benchmarks.closed_loop.pushes import run_pushes

    found: list[Any] = []
    for fixture in (False, True):
        pushes = run_pushes(
            folder / str(fixture),
            operator,
            count=options.pushes,
            seed=options.seed,
            fixture=fixture,
            base_error=options.base_error,
        )
        _print_pushes(pushes, fixture, options.pushes)
        found += pushes
    kept = all(each.breach_mm is None for each in found if each.fixture)
    complete = all(sum(e.fixture is f for e in found) == options.pushes for f in (False, True))
    breached = all(
        each.lowest_mm < STOP_MM for each in found if not each.fixture and not each.stops
    )
    return found, kept and breached and complete


def _print_pushes(pushes: "Sequence[Push]", fixture: bool, count: int) -> None:
    name = "with" if fixture else "without"
    if not pushes:
        print(f"{name} the fixture: no push of {count} began beside the tumour")
        return
    lowest = sorted(each.lowest_mm for each in pushes)
    free = [each for each in pushes if not each.stops]
    print(
        f"{name} the fixture: {len(pushes)} of {count} pushes, lowest true distance "
        f"{lowest[0]:.2f} to {lowest[-1]:.2f} mm, {sum(each < STOP_MM for each in lowest)} "
        f"below {STOP_MM:g} mm, {sum(each.breach_mm is not None for each in pushes)} of them by "
        "the tool's own motion; "
        f"{len(pushes) - len(free)} pushes with a safe stop, load {os.getloadavg()[0]:.1f}"
    )
    if free:
        print(
            f"  without a stop: approach up to {max(e.approach_mm_s for e in free):.0f} mm/s, "
            f"sliding {min(e.slide_mm_s for e in free):.0f} to "
            f"{max(e.slide_mm_s for e in free):.0f} mm/s, retreat "
            f"{min(e.retreat_mm_s for e in free):.0f} to "
            f"{max(e.retreat_mm_s for e in free):.0f} mm/s"
        )


def _run_stops(
    options: argparse.Namespace, folder: Path, operator: "Operator"
) -> tuple[list[Any], bool]:
    """The table of failures; true if all were measured and the arm stood in time."""
    from benchmarks.closed_loop.stops import ALLOWED_MS, LIMITS_MS, SIGNALS, run_stop

    found: list[Any] = []
    is_good = True
    print(f"{'process':12s}{'signal':9s}{'before':>10s}{'below 1 mm/s':>14s}{'limit':>11s}  lowest")
    for process in options.process or LIMITS_MS:
        for number in SIGNALS:
            row = run_stop(
                folder / f"{process}-{number.name}",
                operator,
                process=process,
                number=number,
                seed=options.seed,
            )
            if row is None:
                print(f"{process:12s}{number.name:9s}  not measured: other stops came first")
                is_good = False
                continue
            found.append(row)
            is_good = is_good and row.is_safe
            still = "moves" if row.still_ms is None else f"{row.still_ms:.0f} ms"
            again = "" if row.again_mm is None else f", after it goes on {row.again_mm:.1f} mm"
            print(
                f"{process:12s}{number.name:9s}{row.speed_mm_s:5.0f} mm/s{still:>14s}"
                f"{row.limit_ms:5.0f}+{ALLOWED_MS:.0f} ms  {row.lowest_mm:.1f} mm{again}",
                flush=True,
            )
    print(f"load {os.getloadavg()[0]:.1f}")
    return found, is_good


if __name__ == "__main__":
    sys.exit(main())
