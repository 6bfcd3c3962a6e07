"""Recorded cases that other processes open and replay, below one folder."""

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from app.geometry import NS_PER_S, InputError

if TYPE_CHECKING:
    from app.bridge.replay_node import (
        CaseInfo,
        ReplayPart,
        ReplayProgress,
        ReplayTotals,
    )
    from app.runtime import PreparedCase


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

    def load(self, folder: str) -> "CaseInfo":
        """Open the case; an empty name means the open one. Raises `InputError` without a case."""
        from app.bridge.replay_node import CaseInfo

        opened = self._open(folder)
        return CaseInfo(opened.content.name, opened.extent.frames, opened.extent.duration_s)

    def play(
        self,
        part: "ReplayPart",
        report: Callable[["ReplayProgress"], None],
        stops: Callable[[Callable[[], None]], None],
    ) -> "ReplayTotals":
        """Replay ``part`` over ROS, calling ``report`` at every frame, until its end or a stop."""
        from app.analysis import find_breaches
        from app.bridge import replay_node
        from app.bridge.replay_node import ReplayProgress, ReplayTotals
        from app.report import ReplayLog
        from app.runtime import ReplayRun

        opened, log = self._open(part.folder), ReplayLog()
        run = ReplayRun(
            opened,
            clock_ns=time.monotonic_ns,
            rate=part.rate,
            start_s=part.start_s,
            end_s=part.end_s,
            outputs=(log,),
        )
        stops(run.stop)
        first_ns = opened.extent.first_ns
        with replay_node(run, real_time=part.rate is not None):
            for step in run.steps():
                time_s = (step.frame.stamp.ns - first_ns) / NS_PER_S
                row = log.rows[-1]
                report(ReplayProgress(time_s, len(log.rows), row.state, row.signed_distance_mm))
        distances = [row.signed_distance_mm for row in log.rows]
        return ReplayTotals(
            frames=len(log.rows),
            breaches=len(find_breaches(log.rows, opened.setup.margins.stale_after_ns)),
            min_signed_distance_mm=min((d for d in distances if d is not None), default=None),
        )

    def _open(self, folder: str) -> "PreparedCase":
        with self._lock:
            if self._opened is None or folder not in ("", self._folder):
                self._opened, self._folder = self._read(folder), folder
            return self._opened

    def _read(self, folder: str) -> "PreparedCase":
        from app.files.paths import resolve_inside
        from app.runtime import prepare_case

        if not folder:
            raise InputError("case_folder is empty: no case is open; expected the folder of a case")
        path = resolve_inside(self._root, folder, "case_folder")
        prepared = prepare_case(path, package_dirs=self._package_dirs, tip_only=self._tip_only)
        _ = prepared.extent  # read now, so that an empty recording is refused here
        return prepared
