"""Serve replays of cases and calibrations of tools as ROS 2 actions, until a signal.

The node is marginguard_server, with the actions ~/replay and ~/calibrate and the service
~/load_case. While a case is replayed the node marginguard runs as in 'marginguard replay', with
the player's services.
"""

import argparse
import sys
import threading
from pathlib import Path

from app.cli.options import add_package_dirs, input_argument
from app.cli.ros import load_bridge, print_reach
from app.cli.signals import note_signals

SUMMARY = "replay and calibrate for other processes, as ROS 2 actions"
NODE_NAME = "marginguard_server"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard serve``."""
    parser.add_argument(
        "--cases",
        type=input_argument,
        default=Path(),
        metavar="DIR",
        help="only cases below this folder can be opened; default: the current one; "
        "package://marginguard has the shipped case, recorded_case",
    )
    parser.add_argument(
        "--load", metavar="CASE", help="open this case at once, its folder below DIR"
    )
    add_package_dirs(parser)
    parser.add_argument(
        "--tip-only", action="store_true", help="check the tool's tip instead of its whole mesh"
    )


def run(options: argparse.Namespace) -> int:
    """Serve until SIGINT or SIGTERM; both end the command with exit status 0."""
    with note_signals() as received:
        load_bridge("which 'serve' needs")
        from app.bridge import RosNode
        from app.bridge.calls.calibrate_server import CalibrateServer
        from app.bridge.replay_node import ReplayServer
        from app.bridge.tf import TransformBuffer
        from app.bridge.tf_topics import TfListener
        from app.cli.served_cases import ServedCases

        cases = ServedCases(
            options.cases, package_dirs=options.package_dirs, tip_only=options.tip_only
        )
        if options.load:
            with received.ends_at_once():
                cases.load(options.load)
        print_reach()
        ended = threading.Event()
        received.stops(ended.set)
        with RosNode(NODE_NAME) as ros:
            buffer = TransformBuffer()
            TfListener(ros, buffer)
            ReplayServer(ros, cases)
            CalibrateServer(ros, buffer)
            print(f"/{NODE_NAME} serves cases below {options.cases.resolve()}", file=sys.stderr)
            ended.wait()
    return 0
