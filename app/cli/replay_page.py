"""The page of a recorded case: all of it is stepped through first, then displayed."""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from app import __version__
from app.cli.process import SignalState
from app.cli.progress import with_progress
from app.cli.scene_picture import MOVIE, SCENE, VIDEO, ScenePainter
from app.files.extras import check_installed
from app.geometry import InputError

if TYPE_CHECKING:
    from app.cli.scene_log import SceneLog
    from app.files.volume_file import Volume
    from app.report import ReplayLog, ReplayRecord
    from app.runtime import ReplayRun, SessionContent
    from app.viewer import ReplayFeed, ReplayTimeline, Viewer
    from app.workflow import ApproachGhost, EventNotes, NeedleGuide

MOVIE_S = 10.0
"""Longest duration of the exported movie, to which time is compressed."""


@dataclass(frozen=True, slots=True, eq=False)
class ReplayParts:
    """A case that was stepped through, with the parts of its page and its report."""

    run: "ReplayRun"
    log: "ReplayLog"
    feed: "ReplayFeed"
    timeline: "ReplayTimeline"
    notes: "EventNotes"
    scene_log: "SceneLog"
    _engine: threading.Lock = field(default_factory=threading.Lock)
    """Held while the proximity engine is used, which is not thread-safe."""

    @property
    def content(self) -> "SessionContent":
        """The content of the session."""
        return self.run.prepared.content

    @property
    def exports(self) -> "dict[str, Callable[[], bytes]]":
        """By file name, what makes a file of these steps, as ``marginguard replay`` writes it."""
        makers = {
            "report.html": lambda: self._report_file("report.html"),
            "report.pdf": self._pdf,
            "margin.csv": self._margin_csv,
            "scene.mrb": lambda: self._drawn(SCENE),
            "movie.gif": lambda: self._drawn(MOVIE),
            "movie.mp4": lambda: self._drawn(VIDEO),
        }
        return {name: make for name, make in makers.items() if name not in self.missing}

    @property
    def missing(self) -> dict[str, str]:
        """By file name, why a file is not among `exports`."""
        try:
            check_installed("av")
        except InputError as error:
            return {"movie.mp4": str(error)}
        return {}

    def _record(self) -> "ReplayRecord":
        """The record of the steps, with the notes of operators."""
        from app.report import record_of

        with self._engine:
            record = record_of(self.run, self.log)
        events = (note.line for note in self.notes.entries)
        return replace(record, notes=(*record.notes, *events))

    def _report_file(self, name: str) -> bytes:
        from app.report import analysed_replay, write_report

        with ScenePainter() as painter, TemporaryDirectory() as folder:
            if self.log.deepest is not None:
                painter.begin(self.content, self.log.deepest)
            write_report(
                Path(folder),
                self._record(),
                scene_png=painter.picture,
                version=__version__,
                analysed=analysed_replay(self.run, self.log, __version__),
            )
            return (Path(folder) / name).read_bytes()

    def _pdf(self) -> bytes:
        from app.analysis import case_insertion
        from app.cli.replay_report import pdf_of
        from app.report import summarise
        from app.report.methods import input_digests

        record = self._record()
        digests = input_digests(self.run.prepared.case)
        insertion = case_insertion(self.log.samples(), self.content.tumor)
        with ScenePainter() as painter:
            if self.log.deepest is not None:
                painter.begin(self.content, self.log.deepest)
            return pdf_of(record, summarise(record), painter.picture(), digests, insertion)

    def _margin_csv(self) -> bytes:
        from app.report import margin_csv

        others = {name: log.rows for name, log in self.log.structures.items()}
        return margin_csv(self.log.rows, others).encode()

    def _drawn(self, output: str) -> bytes:
        with ScenePainter() as painter:
            if self.log.deepest is not None:
                painter.begin(self.content, self.log.deepest, outputs=(output,), log=self.scene_log)
            return painter.content(output)


def replay_parts(
    folder: Path,
    package_dirs: Sequence[Path],
    received: SignalState,
    *,
    tip_only: bool,
    tool: str | None = None,
) -> ReplayParts | None:
    """Step through the case in ``folder``; None when a signal came before its last step."""
    with received.ends_at_once():
        from app.analysis import find_breaches
        from app.cli.scene_log import PICTURES_PER_S, SceneLog
        from app.report import ReplayLog
        from app.runtime import ReplayRun, prepare_case, stop_surface
        from app.viewer import (
            ReplayFeed,
            ReplayTimeline,
            ViewStateBuilder,
        )
        from app.workflow import EventNotes

        prepared = prepare_case(folder, package_dirs=package_dirs, tip_only=tip_only, tool=tool)
    setup, log = prepared.setup, ReplayLog()
    scene_log = SceneLog(recording=True, max_keyframes=round(PICTURES_PER_S * MOVIE_S))
    builder = ViewStateBuilder(prepared.content, stop_surface(prepared.content))
    run = ReplayRun(
        prepared,
        clock_ns=time.monotonic_ns,
        stopwatch_ns=time.perf_counter_ns,
        outputs=(log, scene_log),
    )
    received.stops(run.stop)
    steps = with_progress(run.steps(), "stepping through frame")
    shown = [builder.observe(step) for step in steps]
    if received.number is not None:
        return None
    feed = ReplayFeed(shown, time.monotonic_ns)
    breaches = find_breaches(log.rows, setup.margins.stale_after_ns)
    timeline = ReplayTimeline(feed, [(breach.first, breach.last) for breach in breaches])
    return ReplayParts(run, log, feed, timeline, EventNotes(), scene_log)


def replay_page(
    parts: ReplayParts,
    *,
    client: bool = False,
    volume: "Volume | None" = None,
    plans: "tuple[ApproachGhost, NeedleGuide] | None" = None,
) -> "Viewer":
    """A page for a case that was stepped through; ``client``: the browser draws the scene.

    ``volume`` is cut through the tool's tip; ``plans`` are shown beside the steps.
    """
    from app.case import open_case_images
    from app.viewer import SceneView, Title, Viewer
    from app.viewer.plan_part import planned_parts

    images = open_case_images(parts.run.prepared.case)
    title = Title(
        parts.content.name,
        live=False,
        exports=parts.exports,
        missing=parts.missing,
        images=images,
        volume=volume,
        notes=parts.notes,
    )
    return Viewer(
        SceneView(parts.content, added=planned_parts(plans)),
        parts.feed,
        parts.timeline,
        title,
        parts.feed.control,
        client=client,
        plans=plans,
    )
