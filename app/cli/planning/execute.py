"""Execute a planned approach with an arm, beside a running guard.

PLAN is the JSON of 'plan approach --guard', CONTROL the control.yaml of the arm, or its folder. The
arm must stand at the plan's start, and the guard must have the setup that the plan was made for.
Sends joint positions (servo_jp) along the path 200 times per second. The motion is slowed down so
that the guard's constraint is kept, and never leaves the path. It stops for good, within the
accelerations of the plan, when the constraint is missing, invalid, too old, on hold or of another
setup, when joints or poses are missing, when the arm does not follow, when the planes block it for
2 s, on Ctrl-C and on the service ~/cancel (std_srvs/Trigger) of the node marginguard_execute. Then
plan again from where the arm stands. It must be the only sender on the arm's motion topics.
'plan serve' executes the plans that come as goals of an action.

Exit status: 0 at the goal, 1 after a stop, 2 if the motion may not begin, 130 or 143 after a
signal.
"""

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.options import input_argument

if TYPE_CHECKING:
    from app.control import ExecutionStep

NAME = "execute"
SUMMARY = "move an arm along a planned approach, within the constraint of a guard"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``marginguard plan execute``."""
    parser.add_argument(
        "plan_file", type=input_argument, metavar="PLAN", help="JSON of 'plan approach --guard'"
    )
    parser.add_argument("control", type=Path, metavar="CONTROL", help="control.yaml or its folder")


def run(options: argparse.Namespace) -> int:
    """Execute the plan until it has arrived or is stopped."""
    from app.cli.process import note_signals
    from app.cli.ros import load_ros

    with note_signals() as received:
        load_ros("which 'plan execute' needs")
        with received.ends_at_once():
            from app.bridge import RosNode
            from app.bridge.plan_execution import NODE_NAME, ExecutionNode
            from app.cli.process import prompt_process
            from app.control import Outcome, open_control, read_plan

            plan = read_plan(options.plan_file)
            description = open_control(options.control)
        with RosNode(NODE_NAME) as ros, prompt_process():
            node = ExecutionNode(ros, description, clock_ns=time.time_ns)
            print(f"EXECUTION with arm {description.arm}; Ctrl-C stops it", flush=True)
            received.stops(node.cancel)
            last = node.run(plan, _report)
    if last is None:
        print("cancelled before it began", file=sys.stderr)
        return received.exit_status or 1
    if last.outcome is Outcome.ARRIVED:
        print("arrived")
        return received.exit_status
    print(
        f"stopped after {_percent(last)} of the motion: {last.text}; plan again from where the arm "
        "stands",
        file=sys.stderr,
    )
    return received.exit_status or 1


def _report(step: "ExecutionStep") -> None:
    print(_percent(step), flush=True)


def _percent(step: "ExecutionStep") -> str:
    return f"{100.0 * step.progress:.0f} %"
