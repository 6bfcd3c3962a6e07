"""Serve replays of cases and calibrations of tools as ROS 2 actions, until a signal.

The node is marginguard_server, with the actions ~/replay and ~/calibrate and the service
~/load_case. While a case is replayed the node marginguard runs as in 'marginguard replay', with
the player's services.
"""

import argparse
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.options import add_package_dirs, add_tip_only, input_argument
from app.cli.process import note_signals
from app.cli.ros import load_ros
from app.geometry import NS_PER_S, InputError

if TYPE_CHECKING:
    from app.bridge.replay_node import ReplayProgress, ReplayTotals
    from app.runtime import PreparedCase


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
    add_tip_only(parser)


def run(options: argparse.Namespace) -> int:
    """Serve until SIGINT or SIGTERM; both end the command with exit status 0."""
    with note_signals() as received:
        load_ros("which 'serve' needs")
        from app.bridge import RosNode
        from app.bridge.calls.calibrate_server import CalibrateServer
        from app.bridge.replay_node import ReplayServer
        from app.bridge.tf import TransformBuffer
        from app.bridge.tf_topics import TfListener

        cases = ServedCases(
            options.cases, package_dirs=options.package_dirs, tip_only=options.tip_only
        )
        if options.load:
            with received.ends_at_once():
                cases.load(options.load)
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


class ServedCases:
    """Cases below ``root``: a request over the network can open no other.

    The case that was opened last stays open. A replay keeps the one that it started with.
    """

    def __init__(self, root: Path, *, package_dirs: Sequence[Path], tip_only: bool) -> None:
        if not root.is_dir():
            raise InputError(f"{root}: not found; expected a folder of cases")
        self._root = root
        self._package_dirs = tuple(package_dirs)
        self._tip_only = tip_only
        self._lock = threading.Lock()
        self._folder = ""
        self._opened: PreparedCase | None = None

    def load(self, folder: str) -> "PreparedCase":
        """Open the case; an empty name means the open one. Raises `InputError` without a case."""
        with self._lock:
            if self._opened is None or folder not in ("", self._folder):
                self._opened, self._folder = self._read(folder), folder
            return self._opened

    def play(
        self,
        opened: "PreparedCase",
        *,
        rate: float | None,
        start_s: float,
        end_s: float,
        on_progress: Callable[["ReplayProgress"], None],
        on_cancel: Callable[[Callable[[], None]], None],
    ) -> "ReplayTotals":
        """Replay a part of ``opened`` over ROS, until its end or a stop; see `Cases`."""
        from app.analysis import find_breaches
        from app.bridge import replay_node
        from app.bridge.replay_node import ReplayProgress, ReplayTotals
        from app.report import ReplayLog
        from app.runtime import ReplayRun

        log = ReplayLog()
        run = ReplayRun(
            opened,
            clock_ns=time.monotonic_ns,
            rate=rate,
            start_s=start_s,
            end_s=end_s,
            outputs=(log,),
        )
        on_cancel(run.stop)
        first_ns = opened.extent.first_ns
        with replay_node(run, real_time=rate is not None):
            for step in run.steps():
                time_s = (step.frame.stamp.ns - first_ns) / NS_PER_S
                row = log.rows[-1]
                on_progress(
                    ReplayProgress(time_s, len(log.rows), row.state, row.signed_distance_mm)
                )
        distances = [row.signed_distance_mm for row in log.rows]
        return ReplayTotals(
            frames=len(log.rows),
            breaches=len(find_breaches(log.rows, opened.setup.margins.stale_after_ns)),
            min_signed_distance_mm=min((d for d in distances if d is not None), default=None),
        )

    def _read(self, folder: str) -> "PreparedCase":
        from app.files.paths import resolve_inside
        from app.runtime import prepare_case

        if not folder:
            raise InputError("case_folder is empty: no case is open; expected the folder of a case")
        path = resolve_inside(self._root, folder, "case_folder")
        prepared = prepare_case(path, package_dirs=self._package_dirs, tip_only=self._tip_only)
        _ = prepared.extent  # read now, so that an empty recording is refused here
        return prepared
