"""Show the hold of a running guard and end it, as the service ~/rearm does.

The guard is the running session that publishes the constraint: 'live' or 'view --live'. On hold
only motion away from the planes and along them is allowed, until an operator re-arms.

Exit status: 0 when the guard is re-armed or not on hold; 1 when it refuses, or when the question is
answered with no; 2 when there is no guard.
"""

import argparse
import math
import sys
import time
from typing import TYPE_CHECKING

from app.cli.options import add_namespace
from app.cli.ros import load_bridge, print_reach

if TYPE_CHECKING:
    from marginguard_msgs.msg import FixtureConstraint

SUMMARY = "show the hold of a running guard, and end it"

TIMEOUT_S = 10.0
"""Longest wait for a constraint, and for the reply."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard rearm``."""
    add_namespace(parser)
    parser.add_argument(
        "--yes", action="store_true", help="re-arm without a question, also without a terminal"
    )


def run(options: argparse.Namespace) -> int:
    """Show the hold, ask, re-arm."""
    from app.geometry import InputError

    if not options.yes and not sys.stdin.isatty():
        raise InputError("standard input is not a terminal; expected a terminal, or --yes")
    load_bridge("which 'rearm' needs")
    print_reach()
    from app.bridge import RosNode
    from app.bridge.live import RearmClient
    from app.bridge.publishing.session_publisher import NODE_NAME

    with RosNode("marginguard_rearm", namespace=options.namespace) as ros:
        client = RearmClient(ros, NODE_NAME)
        seen = client.constraint(TIMEOUT_S)
        print(hold_text(seen, client.topic, time.time()))
        if not seen.hold:
            return 0
        if seen.rearm_nonce == 0:
            print("refused: this hold ends by itself, with its reasons")
            return 1
        if not options.yes and not _confirmed():
            print("not re-armed")
            return 1
        response = client.rearm(seen, TIMEOUT_S)
        if response.success:
            print("re-armed")
            return 0
        now = client.constraint(TIMEOUT_S)
        print(f"refused: {response.message} (reasons now: {', '.join(now.reasons)})")
        return 1


def _confirmed() -> bool:
    print("Re-arm? [y/N] ", end="", flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def hold_text(seen: "FixtureConstraint", topic: str, now_s: float) -> str:
    """State, reasons, begin of the hold and ids of a constraint, as lines."""
    from app.fixture import MarginState

    if not seen.hold:
        return f"{topic}: {MarginState(seen.state).name}, not on hold"
    since_s = seen.hold_since.sec + seen.hold_since.nanosec * 1e-9
    begin = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(since_s))
    distance_mm = 1000.0 * seen.signed_distance
    rows = {
        "reasons": ", ".join(seen.reasons),
        "on hold since": f"{begin} ({now_s - since_s:.0f} s)",
        "distance": f"{distance_mm:.2f} mm" if math.isfinite(distance_mm) else "unknown",
        "tumour": seen.model_id,
        "registration": seen.registration_id or "none",
        "guard": seen.instance_id,
        "seq, nonce": f"{seen.seq}, {seen.rearm_nonce}",
    }
    return "\n".join(
        [
            f"{topic}: {MarginState(seen.state).name}, on hold",
            *(f"  {name:<15}{value}" for name, value in rows.items()),
        ]
    )
