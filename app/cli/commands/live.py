"""Monitor the margin live: as 'replay', but with samples from ROS 2 or OpenIGTLink.

Prints a line for each change of the state or the hold, and for worse reasons, at once; for better
reasons after they have lasted. Each line begins with the local time of the step's stamp, or, with
'clock: estimate', with the system time at which it is printed. Runs until SIGINT (exit status 130)
or SIGTERM (143); exit status 2 on bad input.
"""

import argparse
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING

from app.cli.options import (
    LIVE_EXAMPLE,
    add_audit,
    add_cases,
    add_json,
    add_namespace,
    add_package_dirs,
    add_tool,
    input_argument,
    quantity,
)
from app.cli.process import SignalState, note_signals, prompt_process
from app.cli.ros import load_ros

if TYPE_CHECKING:
    from app.bridge.node import RosNode
    from app.cli.live_lines import LinePrinter
    from app.runtime import LiveRun
    from app.session import StepResult

SUMMARY = "monitor the margin live, with samples from ROS 2 or OpenIGTLink"

MAX_HZ = 1000.0
"""Highest rate at which the constraint can be repeated."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard live``."""
    parser.add_argument(
        "--config",
        type=input_argument,
        required=True,
        metavar="FILE",
        help="live.yaml with the topics, the tool and the tumour of the session: docs/live.md; "
        f"an example: {LIVE_EXAMPLE}",
    )
    add_package_dirs(parser)
    add_tool(parser)
    add_namespace(parser)
    parser.add_argument(
        "--constraint-hz",
        type=quantity("Hz", f"more than 0, up to {MAX_HZ:g} Hz", lambda hz: 0.0 < hz <= MAX_HZ),
        default=MAX_HZ,
        metavar="HZ",
        help=f"rate at which the constraint is repeated, up to {MAX_HZ:g}; default: {MAX_HZ:g}",
    )
    parser.add_argument("--tip-only", action=_NoTipOnly, nargs=0, help=argparse.SUPPRESS)
    add_audit(parser)
    add_cases(parser)
    parser.add_argument(
        "--display",
        action="append",
        default=[],
        metavar="NODE",
        help="full name of the node of a display that may send commands, as one of 'operators' in "
        "live.yaml; once for each",
    )
    parser.add_argument(
        "--lifecycle",
        action="store_true",
        help="wait to be configured and activated by other nodes ('ros2 lifecycle set')",
    )
    add_json(parser)


class _NoTipOnly(argparse.Action):
    """Refuses an option of earlier versions."""

    def __call__(self, *_: object) -> None:
        """Raise the error that argparse prints."""
        raise argparse.ArgumentError(
            self, "a guard measures the whole tool; expected a replay ('view CASE', 'replay')"
        )


def run(options: argparse.Namespace) -> int:
    """Step and publish until a signal comes."""
    with note_signals() as received, closing(_StepOutput(as_json=options.json)) as shown:
        load_ros("which a live session needs")
        if options.lifecycle:
            _run_managed(options, received, shown)
        else:
            with _opened(options, received, shown) as node:
                received.stops(node.stop)
                with closing(node.steps()) as steps:
                    _print_changes(steps, shown)
    return received.exit_status


def _run_managed(options: argparse.Namespace, received: SignalState, shown: "_StepOutput") -> None:
    """Run as a lifecycle node until a signal comes or its session fails."""
    from app.bridge.control.lifecycle import LifecycleRosNode
    from app.bridge.live.live_node import LiveNodeLifecycle
    from app.bridge.publishing.session_publisher import NODE_NAME

    ended = threading.Event()
    errors: list[Exception] = []

    def failed(error: Exception) -> None:
        errors.append(error)
        ended.set()

    received.stops(ended.set)
    managed = LiveNodeLifecycle(
        lambda ros: _opened(options, received, shown, ros),
        lambda steps: _print_changes(steps, shown),
        failed,
    )
    with LifecycleRosNode(NODE_NAME, managed, namespace=options.namespace):
        print("unconfigured: configure and activate it", file=sys.stderr, flush=True)
        ended.wait()
    if errors:
        raise errors[0]


@contextmanager
def _opened(
    options: argparse.Namespace,
    received: SignalState,
    shown: "_StepOutput",
    ros: "RosNode | None" = None,
) -> Iterator["LiveRun"]:
    with received.ends_at_once():
        from app.bridge.live.live_node import live_node
        from app.runtime import prepare_live

        prepared = prepare_live(
            options.config, package_dirs=options.package_dirs, tool=options.tool
        )
        for note in prepared.case.notes():
            print(note, file=sys.stderr)
    with (
        prompt_process(),
        live_node(
            prepared,
            namespace=options.namespace,
            constraint_hz=options.constraint_hz,
            ros=ros,
            audit=options.audit,
            cases=options.cases,
            displays=options.display,
        ) as node,
    ):
        shown.begin(node, stamps_of_host=prepared.config.stamps_of_host)
        yield node


def _print_changes(steps: "Iterator[StepResult]", shown: "_StepOutput") -> None:
    from app.cli.live_lines import state_changes

    for step in state_changes(steps):
        shown.print(step)


class _StepOutput:
    """Prints the steps of the node that was opened last."""

    def __init__(self, *, as_json: bool) -> None:
        self._as_json = as_json
        self._printer: LinePrinter | None = None

    def begin(self, node: "LiveRun", *, stamps_of_host: bool) -> None:
        """Print the steps of ``node`` from now on."""
        from app.cli.live_lines import LinePrinter

        self.close()
        self._node = node
        self._printer = LinePrinter(
            sys.stdout, as_json=self._as_json, stamps_of_host=stamps_of_host
        )

    def print(self, step: "StepResult") -> None:
        """Print one line; begin first."""
        if self._printer is not None:
            self._printer.print(step, self._node.commands.content)

    def close(self) -> None:
        """Wait for the reader of the lines, 1 s at most. Idempotent."""
        printer, self._printer = self._printer, None
        if printer is not None:
            printer.close()
