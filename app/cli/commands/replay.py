"""Replay a recorded case: register, check the tool against the tumour, publish the fixture, report.

Exit status: 0; 1 when the case's expected.yaml does not hold; 2 on bad input; 130 or 143 when a
signal came: the report is there whole or not at all.
"""

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

from app.cli.gc_control import GcPause
from app.cli.options import add_case, add_json, file_path, folder_path
from app.cli.progress import with_progress
from app.cli.publishing import publishing
from app.cli.scene_log import SceneLog
from app.cli.scene_picture import MOVIE, PICTURE, SCENE, ScenePainter
from app.cli.signals import SignalState, note_signals
from app.cli.stopwatch import Stopwatch
from app.cli.summary_text import as_text

if TYPE_CHECKING:
    from app.case import Case, Player
    from app.report import ReplayLog, ReplayRecord
    from app.session import Session, SessionSetup, StepResult

SUMMARY = "replay a case, publish it over ROS 2, write a report"

PICTURES_PER_S = 12.5
"""Of a movie."""

_MOST_MOVIE_S = 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard replay``."""
    add_case(parser)
    add_json(parser)
    parser.add_argument(
        "--report", type=folder_path, metavar="DIR", help="write the report files there"
    )
    parser.add_argument(
        "--save-scene",
        type=file_path(".mrb"),
        metavar="FILE.mrb",
        help="save the deepest moment as a scene of 3D Slicer, with the whole recording in it",
    )
    parser.add_argument(
        "--movie", type=file_path(".gif"), metavar="FILE.gif", help="draw the replay, animated"
    )
    parser.add_argument(
        "--movie-seconds",
        type=_movie_seconds,
        default=10.0,
        metavar="S",
        help="how long the movie may last (default: 10): time is compressed to that",
    )
    parser.add_argument(
        "--rate",
        type=float,
        metavar="R",
        help="1 is real time, 2 twice as fast; without it the replay goes as fast as it can",
    )
    parser.add_argument("--loop", action="store_true", help="start again at the end, with --rate")
    parser.add_argument("--no-ros", action="store_true", help="publish nothing, load no ROS")
    parser.add_argument(
        "--tip-only", action="store_true", help="check the tool's tip instead of its whole mesh"
    )
    parser.add_argument(
        "--timing", action="store_true", help="say on standard error where the time went"
    )


def run(options: argparse.Namespace) -> int:
    """Replay the case; what is published and what is reported come from the same steps."""
    with note_signals() as received, GcPause() as memory:
        status = _replay(options, received, memory)
    return received.exit_status or status


def _replay(options: argparse.Namespace, received: SignalState, memory: GcPause) -> int:
    if not _wanted(options):
        return _played(options, received, memory, None)
    with ScenePainter() as painter:
        return _played(options, received, memory, painter)


def _played(
    options: argparse.Namespace,
    received: SignalState,
    memory: GcPause,
    painter: ScenePainter | None,
) -> int:
    watch = Stopwatch()
    with received.ends_at_once():
        from app import __version__
        from app.case import Player, open_case
        from app.files import write_file
        from app.report import all_passed, summarise, write_report
        from app.runtime import content_of
        from app.session import setup_from_case, with_estimated_clock, with_repaired_tumor

        watch.lap("load the program")
        _check(options)
        wanted = _wanted(options)
        opened = open_case(options.case, package_dirs=options.package_dirs)
        case, clock = with_estimated_clock(with_repaired_tumor(opened))
        watch.lap("open the case")
        setup = setup_from_case(case, tip_only=options.tip_only)
        memory.settle()
        watch.lap("meshes, robot, registration")
    player = Player(case.frames, clock_ns=time.monotonic_ns, rate=options.rate, loop=options.loop)
    received.stops(player.stop)
    scene_log = SceneLog(
        recording=SCENE in wanted,
        pictures=round(PICTURES_PER_S * options.movie_seconds) if MOVIE in wanted else None,
    )
    record, deepest = _play(case, setup, player, options, scene_log)
    watch.lap("read the frames and step")
    if received.number is not None:
        return received.exit_status
    if clock is not None:
        notes = (f"offset of the joints' clock: {clock.reason}", *record.notes)
        record = replace(record, notes=notes)
    if painter is not None and deepest is not None:
        content = content_of(case, setup, tip_only=options.tip_only)
        painter.begin(content, deepest, outputs=wanted, log=scene_log)
    if painter is None or options.report is None:
        summary = summarise(record)
    else:
        summary = write_report(
            options.report, record, scene_png=painter.picture, version=__version__
        )
    watch.lap("write the report")
    if painter is not None:
        for name, path in ((SCENE, options.save_scene), (MOVIE, options.movie)):
            if path is not None:
                write_file(path, painter.content(name))
        watch.lap("write scene and movie")
    if options.timing:
        watch.tell()
    print(json.dumps(summary, indent=2) if options.json else as_text(summary, options.report))
    return 0 if all_passed(summary) else 1


def _check(options: argparse.Namespace) -> None:
    """Refuse, before anything is read, what could not be done or not be written in the end."""
    from app.case.frames.player import checked_rate
    from app.files import check_output_path
    from app.geometry import InputError
    from app.report import check_writable

    checked_rate(options.rate)
    if options.loop and (options.rate is None or _wanted(options)):
        raise InputError(
            "--loop is for watching: it takes --rate, and no --report, --save-scene or --movie"
        )
    if options.report is not None:
        check_writable(options.report)
    for path in (options.save_scene, options.movie):
        if path is not None:
            check_output_path(path)


def _wanted(options: argparse.Namespace) -> tuple[str, ...]:
    """What 3D Slicer's scene is to give."""
    asked = {PICTURE: options.report, SCENE: options.save_scene, MOVIE: options.movie}
    return tuple(name for name, path in asked.items() if path is not None)


def _movie_seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of seconds") from error
    if not 1.0 <= seconds <= _MOST_MOVIE_S:
        raise argparse.ArgumentTypeError(f"{text} s: 1 to {_MOST_MOVIE_S:g} s allowed")
    return seconds


def _play(
    case: "Case",
    setup: "SessionSetup",
    player: "Player",
    options: argparse.Namespace,
    scene_log: SceneLog,
) -> tuple["ReplayRecord", "StepResult | None"]:
    from app.report import ReplayLog, ReplayRecord
    from app.session import Session

    session, log = Session(setup), ReplayLog()
    robot_problems: Counter[str] = Counter()
    first_of_kind: dict[str, str] = {}
    with publishing(case, setup, player, options) as publish:
        for frame in with_progress(player.play(), "replaying frame"):
            started_ns = time.perf_counter_ns()
            step = session.step(frame)
            duration_ns = time.perf_counter_ns() - started_ns
            if not options.loop:
                log.add(step, duration_ns)
                scene_log.add(step)
                # Where a tool is out of reach is another place in every frame: the first is told.
                kind = step.robot_problem.partition(":")[0]
                robot_problems[first_of_kind.setdefault(kind, step.robot_problem)] += 1
            publish(step)
    provenance = case.manifest.provenance
    record = ReplayRecord(
        case=case.manifest.name,
        provenance=asdict(provenance),
        rows=tuple(log.rows),
        margins=setup.margins,
        registration=None if setup.robot is None else setup.robot.registration,
        expected=case.expected(),
        durations_ns=tuple(log.durations_ns),
        notes=(*case.notes(), *_notes_of(case, session, log, robot_problems)),
        tip_only=options.tip_only,
    )
    return record, log.deepest


def _notes_of(
    case: "Case", session: "Session", log: "ReplayLog", robot_problems: Counter[str]
) -> Iterator[str]:
    """What a reader of the report should know, though it is no error."""
    from app.fixture import MarginState

    if all(row.state is MarginState.UNKNOWN for row in log.rows):
        frames = ", ".join(session.known_frames) or "none"
        yield f"no frame was valid; the recording has the frames {frames}"
    for target, source in session.never_changed:
        yield f"{target} -> {source} never changed: taken for a fixed transform"
    robot = session.setup.robot
    if robot is None:
        if case.manifest.registration is not None:
            yield "registration is given, but there is no robot to register: it is not used"
        return
    yield from robot.robot.warnings
    if session.frames_problem:
        yield session.frames_problem
    for problem, count in robot_problems.items():
        if problem:
            yield f"robot not shown in {count} of {len(log.rows)} frames: {problem}"
