"""Kill a recorder (SIGKILL) at random times and count what its file lacks.

Another process sends three tools and tf at 200 Hz, joints at 500 Hz and the constraint at 1 kHz,
each message with its time of sending. Lost messages are those after the last recorded one; missed
ones did not arrive although later ones did, which only happens on an overloaded machine. Exit
status 1 when a message that was sent more than 100 ms before a kill is lost, or when the MCAP
library reads fewer messages than our reader.
"""

import argparse
import json
import os
import random
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from app.bridge import prepare_environment
from app.cli.progress import with_progress
from benchmarks.recorder.kills import Kill, run_kill
from benchmarks.ros_domain import reserved_domain

PROMISED_MS = 100.0
_MIN_S, _MAX_S = 1.0, 5.0


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="marginguard bench record",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--kills", type=int, default=20, help="default: 20")
    parser.add_argument("--seed", type=int, default=0, help="of the random times; default: 0")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    options = parser.parse_args()
    if options.kills < 1:
        parser.error(f"--kills is {options.kills}; expected 1 or more")
    return options


def main() -> int:
    options = parsed()
    times = random.Random(options.seed)
    kills = []
    # A separate domain keeps other ROS traffic of this machine out of the figures.
    with reserved_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        prepare_environment()
        for _ in with_progress(range(options.kills), "kills"):
            with tempfile.TemporaryDirectory(prefix="marginguard-record-") as folder:
                kills.append(run_kill(Path(folder), times.uniform(_MIN_S, _MAX_S)))
    Console(width=None if sys.stdout.isatty() else 120).print(_table(kills))
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(kill) for kill in kills], indent=1) + "\n")
    return int(not all(is_good(kill) for kill in kills))


def is_good(kill: Kill) -> bool:
    """True if the promise was kept and the MCAP library reads the whole file."""
    return kill.lost_ms <= PROMISED_MS and kill.in_mcap == kill.recorded > 0


def _table(kills: list[Kill]) -> Table:
    table = Table(title=f"{len(kills)} recorders killed; {os.cpu_count()} cores")
    for name in (
        "kill",
        "recorded",
        "read by mcap",
        "lost ms",
        "missed",
        "lost messages, by topic",
    ):
        table.add_column(name, justify="left" if "topic" in name else "right")
    for number, kill in enumerate(kills, start=1):
        lost = ", ".join(f"{name} {count}" for name, count in kill.lost.items() if count)
        table.add_row(
            str(number), str(kill.recorded), str(kill.in_mcap), f"{kill.lost_ms:.1f}",
            str(kill.missed), lost or "0",
        )  # fmt: skip
    worst = max(kills, key=lambda kill: kill.lost_ms)
    most = max(sum(kill.lost.values()) for kill in kills)
    missed = max(kill.missed for kill in kills)
    table.add_row("max", "", "", f"{worst.lost_ms:.1f}", str(missed), str(most))
    return table


if __name__ == "__main__":
    sys.exit(main())
