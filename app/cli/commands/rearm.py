"""Show the hold of a running guard and end it, as the service ~/rearm does.

The guard is the running session that publishes the constraint: 'live'. On hold
only motion away from the planes and along them is allowed, until an operator re-arms.

Without a reply in time it reads the next constraints and prints whether the hold has ended.

Exit status: 0 when the guard is re-armed or not on hold; 1 when it refuses, when the question is
answered with no, when the hold has changed before the answer, or when it lasts without a reply; 2
when there is no guard.
"""

import argparse
import math
import sys
import time
from typing import TYPE_CHECKING

from app.cli.options import add_namespace
from app.cli.ros import load_ros
from app.fixture import MarginState, Reason
from app.geometry import InputError

if TYPE_CHECKING:
    from marginguard_msgs.msg import FixtureConstraint

    from app.bridge.control.operator_services import RearmClient

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
    for name, stream in (("input", sys.stdin), ("output", sys.stdout)):
        if not options.yes and not stream.isatty():
            raise InputError(f"standard {name} is not a terminal; expected a terminal, or --yes")
    load_ros("which 'rearm' needs")
    from app.bridge import RosNode
    from app.bridge.control.operator_services import RearmClient
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
        if not options.yes:
            if not _confirmed():
                print("not re-armed")
                return 1
            now = client.constraint(TIMEOUT_S)
            changes = changes_for_the_worse(seen, now)
            if changes:
                print(f"not re-armed: {'; '.join(changes)}; start again to see the present hold")
                return 1
            seen = now
        return _rearm(client, seen)


def _confirmed() -> bool:
    import termios

    # An answer that was typed before the hold was displayed is none.
    sys.stdout.flush()
    termios.tcflush(sys.stdin, termios.TCIFLUSH)
    print("Re-arm? [y/N] ", end="", flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def changes_for_the_worse(seen: "FixtureConstraint", now: "FixtureConstraint") -> list[str]:
    """Differences of the hold ``now`` that an operator who saw ``seen`` has not seen; or empty.

    Another nonce, a worse state or more reasons.
    """
    changes = []
    if not now.hold:
        changes.append("the displayed hold has ended")
    elif now.rearm_nonce != seen.rearm_nonce:
        changes.append("the displayed hold was replaced by another one")
    if now.state > seen.state:
        changes.append(f"the state is {MarginState(now.state).name} by now")
    seen_or_good = {*seen.reasons, str(Reason.CLEAR)}
    added = [reason for reason in now.reasons if reason not in seen_or_good]
    if added:
        changes.append(f"reasons were added: {', '.join(added)}")
    causes = [cause for cause in now.hold_causes if cause not in seen.hold_causes]
    if causes and now.hold:
        changes.append(f"causes were added: {'; '.join(causes)}")
    return changes


def _rearm(client: "RearmClient", seen: "FixtureConstraint") -> int:
    """Request the end of the hold ``seen``, print the reply; the exit status."""
    from app.bridge import BridgeError
    from app.bridge.ros_errors import CallTimeoutError, ServerGoneError

    try:
        response = client.rearm(seen, TIMEOUT_S)
    except (CallTimeoutError, ServerGoneError) as error:
        print(f"no reply: {error}", flush=True)
        return _outcome_without_reply(client, seen)
    if response.success:
        print("re-armed")
        return 0
    print(f"refused: {response.message}", flush=True)
    try:
        now = client.constraint(TIMEOUT_S)
    except BridgeError as error:
        print(f"the hold after the refusal is not known: {error}")
        return 1
    hold = f"on hold, nonce {now.rearm_nonce}" if now.hold else "not on hold"
    print(f"next constraint: {hold} (reasons: {', '.join(now.reasons)})")
    return 1


def _outcome_without_reply(client: "RearmClient", seen: "FixtureConstraint") -> int:
    """Print what the next constraint says of the hold ``seen``; the exit status."""
    from app.bridge import BridgeError

    try:
        now = client.constraint(TIMEOUT_S)
    except BridgeError as error:
        print(f"whether the hold has ended is not known: {error}")
        return 1
    if now.instance_id != seen.instance_id:
        print("the guard was replaced: its new hold, if any, is not re-armed")
        return 1
    if not now.hold:
        print("the next constraint is not on hold: re-armed")
        return 0
    if now.rearm_nonce == seen.rearm_nonce:
        print(
            "still on hold: the request was not carried out so far. It can still be until the "
            "nonce is replaced: look at the constraint before you start again"
        )
    else:
        print(f"on another hold, nonce {now.rearm_nonce}: the request has no effect any more")
    return 1


def hold_text(seen: "FixtureConstraint", topic: str, now_s: float) -> str:
    """State, reasons, begin of the hold and ids of a constraint, as lines."""
    if not seen.hold:
        return f"{topic}: {MarginState(seen.state).name}, not on hold"
    since_s = seen.hold_since.sec + seen.hold_since.nanosec * 1e-9
    begin = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(since_s))
    distance_mm = 1000.0 * seen.signed_distance
    rows = {
        "reasons": ", ".join(seen.reasons),
        "causes": f"\n{'':<17}".join(seen.hold_causes) or "none named",
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
