"""Cases that another process asks for: opened below one folder, played as ``replay`` plays them."""

import argparse
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.publishing import publishing
from app.geometry import NS_PER_S, InputError

if TYPE_CHECKING:
    from app.bridge.calls.replay_server import (
        CaseInfo,
        ReplayPart,
        ReplayProgress,
        ReplayTotals,
    )
    from app.case import Case
    from app.session import SessionSetup


@dataclass(frozen=True, slots=True)
class _Opened:
    folder: str
    case: "Case"
    setup: "SessionSetup"
    facts: "CaseInfo"


class ServedCases:
    """Cases below ``root``: whoever asks over the network may open no other.

    The case that was opened last stays open. A replay keeps the one that it began with.
    """

    def __init__(self, root: Path, *, package_dirs: Sequence[Path], tip_only: bool) -> None:
        if not root.is_dir():
            raise InputError(f"{root} is no folder of cases")
        self._root = root
        self._package_dirs = tuple(package_dirs)
        self._tip_only = tip_only
        self._lock = threading.Lock()
        self._opened: _Opened | None = None

    def load(self, folder: str) -> "CaseInfo":
        """Open the case; empty: the one that is open. Raises `InputError` where there is none."""
        return self._open(folder).facts

    def play(
        self,
        part: "ReplayPart",
        tell: Callable[["ReplayProgress"], None],
        stops: Callable[[Callable[[], None]], None],
    ) -> "ReplayTotals":
        """Play ``part`` over ROS, calling ``tell`` at every frame, until it ends or is stopped."""
        from app.bridge.calls.replay_server import ReplayProgress, ReplayTotals
        from app.case import Player
        from app.report import ReplayLog, find_breaches
        from app.session import Session

        opened = self._open(part.folder)
        player = Player(opened.case.frames, clock_ns=time.monotonic_ns, rate=part.rate)
        player.seek(part.start_s)
        stops(player.stop)
        session, log = Session(opened.setup), ReplayLog()
        first_ns = next(opened.case.frames()).stamp.ns
        options = argparse.Namespace(no_ros=False, tip_only=self._tip_only, rate=part.rate)
        with publishing(opened.case, opened.setup, player, options) as publish:
            for frame in player.play():
                time_s = (frame.stamp.ns - first_ns) / NS_PER_S
                if time_s > part.end_s:
                    break
                step = session.step(frame)
                publish(step)
                log.add(step, 0)
                row = log.rows[-1]
                tell(ReplayProgress(time_s, len(log.rows), row.state, row.signed_distance_mm))
        distances = [row.signed_distance_mm for row in log.rows]
        return ReplayTotals(
            frames=len(log.rows),
            breaches=len(find_breaches(log.rows, opened.setup.margins.stale_after_ns)),
            min_signed_distance_mm=min((d for d in distances if d is not None), default=None),
        )

    def _open(self, folder: str) -> _Opened:
        with self._lock:
            if self._opened is None or folder not in ("", self._opened.folder):
                self._opened = self._read(folder)
            return self._opened

    def _read(self, folder: str) -> _Opened:
        from app.bridge.calls.replay_server import CaseInfo
        from app.case import open_case
        from app.files.paths import resolve_inside
        from app.session import setup_from_case, with_estimated_clock, with_repaired_tumor

        if not folder:
            raise InputError("no case is open: its folder wanted")
        path = resolve_inside(self._root, folder, "case_folder")
        opened = open_case(path, package_dirs=self._package_dirs)
        case, _ = with_estimated_clock(with_repaired_tumor(opened))
        setup = setup_from_case(case, tip_only=self._tip_only)
        stamps = [frame.stamp.ns for frame in case.frames()]
        if not stamps:
            raise InputError(f"the recording of {path} has no frame")
        facts = CaseInfo(case.manifest.name, len(stamps), (stamps[-1] - stamps[0]) / NS_PER_S)
        return _Opened(folder, case, setup, facts)
