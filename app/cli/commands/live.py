"""Guard the margin live: what 'replay' does with a file, with samples as they arrive over ROS 2.

A line on standard output tells each change of the state or the hold, and worse reasons, at once;
better reasons, once they have lasted. Runs until SIGINT (exit status 130) or SIGTERM (143); exit
status 2 on bad input.
"""

import argparse
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.options import add_package_dirs
from app.cli.publishing import bridge_loaded
from app.cli.signals import SignalState, note_signals

if TYPE_CHECKING:
    from app.bridge.live import LiveNode
    from app.bridge.node import RosNode
    from app.session import StepResult

SUMMARY = "guard the margin live, with samples as they arrive over ROS 2"

MOST_HZ = 1000.0
"""How often the constraint may be repeated."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard live``."""
    parser.add_argument(
        "--config",
        type=Path,
        required=True,
        metavar="FILE",
        help="what to listen to and to guard, a live.yaml: docs/live.md",
    )
    add_package_dirs(parser)
    parser.add_argument("--namespace", default="", metavar="NS", help="ROS namespace of the node")
    parser.add_argument(
        "--constraint-hz",
        type=_rate_hz,
        default=MOST_HZ,
        metavar="HZ",
        help=f"how often the constraint is repeated, up to {MOST_HZ:g}; default: {MOST_HZ:g}",
    )
    parser.add_argument(
        "--tip-only", action="store_true", help="check the tool's tip instead of its whole mesh"
    )
    parser.add_argument(
        "--lifecycle",
        action="store_true",
        help="wait to be configured and activated by other nodes ('ros2 lifecycle set')",
    )


def _rate_hz(text: str) -> float:
    try:
        rate_hz = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no rate in Hz") from error
    if not 0.0 < rate_hz <= MOST_HZ:
        raise argparse.ArgumentTypeError(f"{text} Hz: more than 0, up to {MOST_HZ:g} Hz allowed")
    return rate_hz


def run(options: argparse.Namespace) -> int:
    """Step and publish until a signal comes."""
    with note_signals() as received:
        bridge_loaded("a live session is ROS")
        if options.lifecycle:
            _be_managed(options, received)
        else:
            with _opened(options, received) as guard:
                received.stops(guard.live.stop)
                with closing(guard.steps()) as steps:
                    _tell(steps)
    return received.exit_status


def _be_managed(options: argparse.Namespace, received: SignalState) -> None:
    from app.bridge.control import LifecycleRosNode
    from app.bridge.live import LiveNodeLifecycle
    from app.bridge.publishing.session_publisher import NODE_NAME

    ended = threading.Event()
    errors: list[Exception] = []

    def failed(error: Exception) -> None:
        errors.append(error)
        ended.set()

    received.stops(ended.set)
    life = LiveNodeLifecycle(lambda ros: _opened(options, received, ros), _tell, failed)
    with LifecycleRosNode(NODE_NAME, life, namespace=options.namespace):
        print("unconfigured: configure and activate it", file=sys.stderr, flush=True)
        ended.wait()
    if errors:
        raise errors[0]


@contextmanager
def _opened(
    options: argparse.Namespace, received: SignalState, ros: "RosNode | None" = None
) -> Iterator["LiveNode"]:
    with received.ends_at_once():
        from app.bridge.live import guarding
        from app.case import open_live
        from app.session import setup_from_case, with_repaired_tumor

        config = open_live(options.config, package_dirs=options.package_dirs)
        case = with_repaired_tumor(config.case)
        for note in case.notes():
            print(note, file=sys.stderr)
        setup = setup_from_case(case, tip_only=options.tip_only)
    with guarding(
        config,
        case,
        setup,
        namespace=options.namespace,
        constraint_hz=options.constraint_hz,
        tip_only=options.tip_only,
        ros=ros,
    ) as guard:
        yield guard


def _tell(steps: "Iterator[StepResult]") -> None:
    from app.cli.state_changes import news

    for step in news(steps):
        print(as_line(step), flush=True)


def as_line(step: "StepResult") -> str:
    """State, distance and reasons of a step, for a person who watches."""
    decision = step.decision
    distance = (
        "" if decision.proximity is None else f" {decision.proximity.signed_distance_mm:.2f} mm"
    )
    reasons = ", ".join(str(reason) for reason in decision.reasons)
    return f"{decision.state.name}{distance}: {reasons}"
