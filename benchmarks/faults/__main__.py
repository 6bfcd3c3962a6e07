"""Inject faults into a live session from outside, and judge what a controller is permitted.

    marginguard bench faults [--rows TEXT ...] [--trials N] [--json FILE]

Real processes: `marginguard live` with the shipped live.yaml, a peer that sends the tracker's poses
and the robot's joints of the recorded case, foreign nodes, and a controller that asks for 50 mm/s
towards the tumour 50 times a second. Only the bench knows the truth: where the tool is, and that a
fault was injected. A message is permissive if it allows an approach: a constraint without hold that
is still valid, or an answer with more than 10 mm/s towards the true tumour. Late ones were sent
more than 30 ms after the row's limit. The whole matrix takes about ten minutes.

Exit status 1 when a row that must be safe is not, or could not be measured. Rows without a second
source of truth are named as residual risks.
"""

import argparse
import json
import os
import platform
import sys
import tempfile
from pathlib import Path

from rich.console import Console

from benchmarks.ros_domain import reserved_domain


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="marginguard bench faults",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--rows",
        nargs="+",
        default=[],
        metavar="TEXT",
        help="only rows whose name contains a text, or matches it as a wildcard",
    )
    parser.add_argument("--list", action="store_true", help="list the rows and end")
    parser.add_argument("--trials", type=int, default=3, help="per row (default: 3)")
    parser.add_argument(
        "--constraint-hz", type=float, default=1000.0, help="of the guard (default: 1000)"
    )
    parser.add_argument(
        "--stale-ms",
        type=float,
        help="stale_after_ms of the guard (default: that of the shipped live.yaml)",
    )
    parser.add_argument("--logs", type=Path, metavar="DIR", help="keep the programs' logs there")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    options = parser.parse_args()
    if options.trials < 1:
        parser.error(f"--trials is {options.trials}; expected 1 or more")
    return options


def main() -> int:
    options = parsed()
    with reserved_domain() as domain, tempfile.TemporaryDirectory() as temporary:
        folder = options.logs or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        return run(options, domain, folder)


def run(options: argparse.Namespace, domain: int, folder: Path) -> int:
    """Run the selected rows in the ROS domain ``domain``; return the exit status."""
    from benchmarks.faults.environment import prepare

    prepare(domain, folder)
    # Load ROS only now: it reads the variables when it is loaded.
    from benchmarks.faults.bench import Bench, Options
    from benchmarks.harness.processes import GuardStartError
    from benchmarks.faults.results import results_table
    from benchmarks.faults.run import run_rows, selected

    rows = selected(options.rows)
    if options.list or not rows:
        print("\n".join(row.label for row in rows) or "no row has such a name; see --list")
        return 0 if rows else 2
    bench = Bench(folder, Options(options.constraint_hz, options.stale_ms))
    results = []
    try:
        for result in run_rows(bench, rows, options.trials, lambda line: print(line, flush=True)):
            results.append(result)
            if options.json is not None:
                machine = {"cores": os.cpu_count(), "kind": platform.machine()}
                document = {
                    "machine": {**machine, "load": os.getloadavg()[0]},
                    "rows": [each.document() for each in results],
                }
                options.json.write_text(json.dumps(document, indent=1) + "\n")
    except GuardStartError as error:
        print(f"marginguard: error: {error}", file=sys.stderr)
        return 1
    finally:
        bench.close()
    console = Console(width=None if sys.stdout.isatty() else 200)
    title = (
        f"{options.trials} trials per row; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    )
    console.print(results_table(results, title), highlight=False)
    return 0 if all(result.passed for result in results) else 1


if __name__ == "__main__":
    sys.exit(main())
