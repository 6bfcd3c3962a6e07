"""The page of a recorded case: all of it is stepped through first, then looked at."""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from app.cli.progress import with_progress
from app.cli.scene_picture import ScenePainter
from app.cli.signals import SignalState

if TYPE_CHECKING:
    from app.case import Case
    from app.report import ReplayLog
    from app.runtime import SessionContent
    from app.session import SessionSetup
    from app.viewer import ReplayFeed, ReplayTimeline, Viewer


@dataclass(frozen=True, slots=True, eq=False)
class ReplayParts:
    """A case that was stepped through: what a page of it is made of, and what its report tells."""

    case: "Case"
    setup: "SessionSetup"
    content: "SessionContent"
    feed: "ReplayFeed"
    timeline: "ReplayTimeline"
    log: "ReplayLog"
    tip_only: bool

    def report(self) -> bytes:
        """The ``report.html`` that ``replay --report`` writes, of the same steps."""
        from app import __version__
        from app.report import ReplayRecord, write_report

        case, setup, log = self.case, self.setup, self.log
        record = ReplayRecord(
            case=case.manifest.name,
            provenance=asdict(case.manifest.provenance),
            rows=tuple(log.rows),
            margins=setup.margins,
            registration=None if setup.robot is None else setup.robot.registration,
            expected=case.expected(),
            durations_ns=tuple(log.durations_ns),
            notes=case.notes(),
            tip_only=self.tip_only,
        )
        with ScenePainter() as painter, TemporaryDirectory() as folder:
            if log.deepest is not None:
                painter.begin(self.content, log.deepest)
            write_report(Path(folder), record, scene_png=painter.picture, version=__version__)
            return (Path(folder) / "report.html").read_bytes()


def replay_parts(
    folder: Path, package_dirs: Sequence[Path], received: SignalState, *, tip_only: bool
) -> ReplayParts | None:
    """Step through the case in ``folder``; None when a signal came before its last step."""
    with received.ends_at_once():
        from app.case import open_case
        from app.report import ReplayLog, find_breaches
        from app.runtime import content_of
        from app.session import Session, setup_from_case, with_estimated_clock, with_repaired_tumor
        from app.viewer import ReplayFeed, ReplayTimeline, Watcher, stop_surface

        opened = open_case(folder, package_dirs=package_dirs)
        case, _ = with_estimated_clock(with_repaired_tumor(opened))
        setup = setup_from_case(case, tip_only=tip_only)
    content = content_of(case, setup, tip_only=tip_only)
    watcher = Watcher(setup, content, stop_surface(content))
    session, log = Session(setup), ReplayLog()
    shown = []
    for frame in with_progress(case.frames(), "stepping through frame"):
        if received.number is not None:
            return None
        began_ns = time.perf_counter_ns()
        step = session.step(frame)
        log.add(step, time.perf_counter_ns() - began_ns)
        shown.append(watcher.see(step))
    feed = ReplayFeed(shown, time.monotonic_ns)
    breaches = find_breaches(log.rows, setup.margins.stale_after_ns)
    timeline = ReplayTimeline(feed, [(breach.first, breach.last) for breach in breaches])
    return ReplayParts(case, setup, content, feed, timeline, log, tip_only)


def replay_page(parts: ReplayParts) -> "Viewer":
    """A page for a case that was stepped through."""
    from app.viewer import SceneView, Title, Viewer

    title = Title(parts.case.manifest.name, live=False, report=parts.report)
    return Viewer(SceneView(parts.content), parts.feed, parts.timeline, title, parts.feed.control)
