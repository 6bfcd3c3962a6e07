"""Close the loop: a hand pushes a simulated arm towards a breathing tumour, in real time over ROS.

    marginguard bench closed-loop [--pushes N] [--first-push K] [--stops] [--json FILE [--append]]
    marginguard bench closed-loop --contact [--json FILE]

Separate processes: the physics with the hand (MuJoCo, 1 kHz), the tracker's driver (50 Hz, 20 ms of
latency, 0.3 mm of correlated noise), 'marginguard live' and 'marginguard control'. The hand pushes
with 10 N from random directions, without and with the fixture. The true distance is measured at
every physics step, by the product's engine and by libigl. With --stops, guard, controller and
tracker are killed and stopped in the middle of an approach instead. On a busy machine safe stops
(holds, watchdog, physics behind real time) interrupt pushes; they are counted by cause, and an
operator re-arms after them. With --first-push and --append a run of many pushes is made in parts,
and the figures are those of all rows of FILE.

With --contact there is one process and no ROS: a tool is pressed on a skull with 20 N for 5 s, its
depth is measured by libigl on MuJoCo's own geometry, and the joint accelerations of random arms are
compared with Pinocchio.

Exit status 1 if the true distance of a push with the fixture is ever below the stop margin (with
--base-error: below 0), if a push without it does not breach the margin, if an arm did not stand in
time after a failure, or if a limit of --contact is exceeded; 2 if a process cannot run.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.files.extras import check_installed
from app.geometry import MarginGuardError
from benchmarks.closed_loop.rows import STOP_MM, lines_of, merged, read_rows
from benchmarks.harness.processes import ChildError
from benchmarks.ros_domain import reserved_domain

if TYPE_CHECKING:
    from benchmarks.closed_loop.loop_operator import Operator


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(
        prog="marginguard bench closed-loop",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--pushes", type=int, default=60, help="pushes of each kind (default: 60)")
    parser.add_argument(
        "--first-push",
        type=int,
        default=0,
        metavar="K",
        help="number of the first push, which with the seed gives its direction (default: 0)",
    )
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
        "--contact", action="store_true", help="contact and dynamics of the physics instead"
    )
    parser.add_argument(
        "--process",
        action="append",
        choices=("guard", "tracker", "controller"),
        help="only failures of this process; once for each (default: all)",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to FILE")
    parser.add_argument(
        "--append", action="store_true", help="add the pushes to those in FILE of an earlier run"
    )
    parser.add_argument(
        "--logs", type=Path, metavar="DIR", help="keep the logs and the truth below DIR"
    )
    options = parser.parse_args(arguments)
    if options.pushes < 1:
        parser.error(f"--pushes is {options.pushes}; expected at least 1")
    if options.first_push < 0:
        parser.error(f"--first-push is {options.first_push}; expected at least 0")
    if options.contact and options.stops:
        parser.error("--contact with --stops; expected one of them")
    if options.append and (options.json is None or options.stops or options.contact):
        parser.error("--append needs --json FILE and pushes; expected both")
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; return its exit status."""
    options = parsed(arguments)
    if options.contact:
        return _run_contact(options)
    try:
        check_installed("mujoco", "coacd", "rclpy", "igl")
        earlier = read_rows(options.json) if options.append else []
        with reserved_domain() as domain, tempfile.TemporaryDirectory() as name:
            folder = Path(name) if options.logs is None else options.logs
            folder.mkdir(parents=True, exist_ok=True)
            _prepare(domain, folder)
            from app.bridge import RosNode
            from benchmarks.closed_loop.loop_operator import Operator

            with RosNode("operator", domain_id=domain) as ros:
                if options.stops:
                    found, is_good = _run_stops(options, folder, Operator(ros))
                    rows = [asdict(each) for each in found]
                else:
                    rows = merged(earlier, _run_pushes(options, folder, Operator(ros)))
                    is_good = _print_pushes(rows, options)
    except (MarginGuardError, ChildError) as error:
        print(f"marginguard bench closed-loop: {error}", file=sys.stderr)
        return 2
    if options.json is not None:
        options.json.write_text(json.dumps({"load": os.getloadavg(), "rows": rows}, indent=2))
    return 0 if is_good else 1


def _run_contact(options: argparse.Namespace) -> int:
    """Print contact and dynamics; return the exit status."""
    try:
        check_installed("mujoco", "coacd", "igl", "pinocchio")
        from benchmarks.closed_loop.contact import FORCE_N, MASSES_KG, convex_error_mm, run_press
        from benchmarks.closed_loop.dynamics import ARMS, STATES, largest_difference

        with tempfile.TemporaryDirectory() as name:
            presses = [run_press(Path(name), mass_kg) for mass_kg in MASSES_KG]
            difference = largest_difference(Path(name), options.seed)
        outside_mm, uncovered_mm = convex_error_mm()
    except MarginGuardError as error:
        print(f"marginguard bench closed-loop: {error}", file=sys.stderr)
        return 2
    for each in presses:
        print(
            f"pressed with {FORCE_N:.0f} N for {each.pressed_s:.1f} s by {each.mass_kg:g} kg: "
            f"{each.impact_mm:.4f} mm deep at the impact and {each.rest_mm:.4f} mm at rest by "
            f"libigl, at most {each.contact_mm:.4f} mm by MuJoCo"
        )
    print(
        f"convex parts: {outside_mm:.2f} mm outside the surface, which they leave uncovered by "
        f"{uncovered_mm:.4f} mm"
    )
    print(
        f"accelerations of {ARMS} random arms in {STATES} states each: {difference:.1e} of the "
        "tolerance (1e-6)"
    )
    if options.json is not None:
        row = {"outside_mm": outside_mm, "uncovered_mm": uncovered_mm, "dynamics": difference}
        rows = [*map(asdict, presses), row]
        options.json.write_text(json.dumps({"load": os.getloadavg(), "rows": rows}, indent=2))
    return 0 if difference <= 1.0 and all(each.is_good for each in presses) else 1


def _prepare(domain: int, folder: Path) -> None:
    from benchmarks.faults.environment import prepare

    prepare(domain, folder)


def _run_pushes(
    options: argparse.Namespace, folder: Path, operator: "Operator"
) -> list[dict[str, Any]]:
    """The rows of the pushes of each kind that the options ask for; prints the processor times."""
    from benchmarks.closed_loop.pushes import run_pushes

    rows = []
    for fixture in (False, True):
        if options.kind != "both" and fixture is not (options.kind == "with"):
            continue
        run = run_pushes(
            folder / str(fixture),
            operator,
            count=options.pushes,
            first=options.first_push,
            seed=options.seed,
            fixture=fixture,
            base_error=options.base_error,
        )
        shares = ", ".join(f"{name} {share:.2f}" for name, share in run.cpu.items())
        print(f"processor time per time, 1 is a core: {shares}; load {os.getloadavg()[0]:.1f}")
        rows += [{**asdict(each), "base_error": options.base_error} for each in run.pushes]
    return rows


def _print_pushes(rows: Sequence[Mapping[str, Any]], options: argparse.Namespace) -> bool:
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
