"""Replay a recorded case: register, check the tool against the tumour, publish the fixture, report.

Exit status: 0; 1 when the case's expected.yaml does not hold; 2 on bad input, or when a part of
--all could not be written; 130 or 143 after a signal: the report is then complete or does not
exist.
"""

import argparse
import json
import os
import sys
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING

from app.cli.bag_writing import BagProcess, bag_of
from app.cli.options import (
    add_case,
    add_json,
    add_tip_only,
    add_tool,
    file_path,
    folder_path,
    quantity,
)
from app.cli.process import GcPause, SignalState, note_signals
from app.cli.progress import with_progress
from app.cli.replay_report import ReplayReport, Stopwatch, summary_text
from app.cli.ros import load_ros
from app.cli.scene_picture import MOVIE, PICTURE, SCENE, VIDEO, ScenePainter
from app.files import check_output_path, write_file
from app.files.extras import check_installed
from app.geometry import InputError

if TYPE_CHECKING:
    from app.runtime import ReplayRun

SUMMARY = "replay a case, publish it over ROS 2, write a report"

_MAX_MOVIE_S = 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard replay``."""
    add_case(parser)
    add_tool(parser)
    add_json(parser)
    parser.add_argument(
        "--report",
        type=folder_path,
        metavar="DIR",
        help="analyse the replay and write the report files there",
    )
    parser.add_argument(
        "--all",
        action="store_true",
        help="with --report: write all results of this replay to DIR, also report.pdf, the tables "
        "of the analysis (CSV), frames.parquet, dicom and the MCAP bag results; needs the extras "
        "ros, dicom and cohort",
    )
    parser.add_argument(
        "--pdf",
        type=file_path(".pdf"),
        metavar="FILE.pdf",
        help="write the report as PDF",
    )
    parser.add_argument(
        "--save-scene",
        type=file_path(".mrb"),
        metavar="FILE.mrb",
        help="save the deepest step as a scene of 3D Slicer, with the whole recording in it",
    )
    parser.add_argument(
        "--mcap",
        type=folder_path,
        metavar="DIR",
        help="write what a replay publishes to the new folder DIR, a rosbag2 folder with one MCAP "
        "file, for Foxglove and 'ros2 bag play'; needs ROS, also with --no-ros",
    )
    parser.add_argument(
        "--movie",
        type=file_path(".gif", ".mp4"),
        metavar="FILE",
        help="draw the replay as an animation: .gif, or .mp4 (H.264) with the extra 'video'",
    )
    parser.add_argument(
        "--movie-seconds",
        type=quantity("s", f"1 to {_MAX_MOVIE_S:g} s", lambda s: 1.0 <= s <= _MAX_MOVIE_S),
        default=10.0,
        metavar="S",
        help="longest duration of the movie, to which time is compressed (default: 10)",
    )
    parser.add_argument(
        "--rate",
        type=float,
        metavar="R",
        help="1 is real time, 2 twice as fast; default: as fast as possible",
    )
    parser.add_argument("--loop", action="store_true", help="start again at the end, with --rate")
    parser.add_argument("--no-ros", action="store_true", help="publish nothing, load no ROS")
    add_tip_only(parser)
    parser.add_argument(
        "--timing", action="store_true", help="print the duration of each stage to standard error"
    )


def run(options: argparse.Namespace) -> int:
    """Replay the case; published messages and report come from the same steps."""
    with note_signals() as received, GcPause() as memory, ExitStack() as processes:
        drawings = _drawings(options)
        painter = processes.enter_context(ScenePainter()) if drawings else None
        bag = None
        if options.mcap is not None or options.all:
            bag = processes.enter_context(BagProcess())
        status = _replay(options, received, memory, drawings, painter, bag)
    return received.exit_status or status


def _replay(
    options: argparse.Namespace,
    received: SignalState,
    memory: GcPause,
    drawings: tuple[str, ...],
    painter: ScenePainter | None,
    bag: BagProcess | None,
) -> int:
    watch = Stopwatch()
    with ExitStack() as contexts:
        with received.ends_at_once():
            from app.cli.scene_log import PICTURES_PER_S, SceneLog
            from app.report import ReplayLog, all_passed, record_of, summarise
            from app.runtime import ReplayRun, prepare_case

            watch.lap("load the program")
            _check(options, drawings)
            report = None
            if options.report is not None or options.pdf is not None:
                report = contexts.enter_context(ReplayReport(options, watch))
            prepared = prepare_case(
                options.case,
                package_dirs=options.package_dirs,
                tip_only=options.tip_only,
                tool=options.tool,
                on_stage=watch.lap,
            )
            memory.settle()
        log = ReplayLog()
        scene_log = SceneLog(
            recording=SCENE in drawings,
            max_keyframes=round(PICTURES_PER_S * options.movie_seconds)
            if options.movie is not None
            else None,
        )
        replay = ReplayRun(
            prepared,
            clock_ns=time.monotonic_ns,
            stopwatch_ns=time.perf_counter_ns,
            rate=options.rate,
            loop=options.loop,
            outputs=() if options.loop else (log, scene_log),
            free_motion=not options.no_ros,
        )
        received.stops(replay.stop)
        if report is not None and options.all:
            assert bag is not None  # started with --all
            contexts.enter_context(report.with_all(replay, bag))
        elif bag is not None:
            contexts.enter_context(
                bag_of(bag, replay, options.mcap, lambda: received.number is None)
            )
        with ExitStack() as node:
            if not options.no_ros:
                load_ros("or --no-ros to replay without it")
                from app.bridge import replay_node

                node.enter_context(replay_node(replay, real_time=options.rate is not None))
            for _ in with_progress(
                replay.steps(), "replaying frame", total=_frames(replay, options)
            ):
                pass
        watch.lap("read the frames and step")
        if received.number is not None:
            return received.exit_status
        record = record_of(replay, log)
        if painter is not None and log.deepest is not None:
            painter.begin(prepared.content, log.deepest, outputs=drawings, log=scene_log)
        if report is None:
            summary = summarise(record)
            watch.lap("summarise")
        else:
            picture = painter.picture if painter is not None else lambda: None
            summary = report.write(replay, log, record, picture)
        if painter is not None:
            for name, path in ((SCENE, options.save_scene), (_movie_kind(options), options.movie)):
                if path is not None:
                    write_file(path, painter.content(name))
                    watch.lap("write scene and movie")
    if bag is not None:
        watch.lap("wait for the bag")
    if options.timing:
        watch.print_laps()
    print(json.dumps(summary, indent=2) if options.json else summary_text(summary, options.report))
    if report is not None and report.incomplete:
        return 2
    return 0 if all_passed(summary) else 1


def _frames(replay: "ReplayRun", options: argparse.Namespace) -> int | None:
    """Number of frames, for the progress; not counted for a fast replay, which it would delay."""
    if options.rate is None or options.loop or not sys.stderr.isatty():
        return None
    return replay.prepared.extent.frames


def _check(options: argparse.Namespace, drawings: tuple[str, ...]) -> None:
    """Reject, before anything is read, options that contradict each other or cannot be written."""
    from app.case.player import checked_rate
    from app.cli.complete_report import check_parts
    from app.report import check_writable

    if not options.no_ros:
        check_installed("rclpy", "marginguard_msgs", otherwise="replay with --no-ros")
    if options.mcap is not None:
        check_installed("rclpy", "marginguard_msgs", otherwise="replay without --mcap")
        if os.path.lexists(options.mcap):
            raise InputError(f"{options.mcap} already exists; refusing to overwrite it")
    if VIDEO in drawings:
        check_installed("av", otherwise="write the movie as .gif")
    checked_rate(options.rate)
    if options.loop and (options.rate is None or drawings or options.mcap):
        raise InputError(
            "--loop: without --rate or with an output file; "
            "expected --rate, and no --report, --pdf, --save-scene, --movie or --mcap"
        )
    if options.all:
        if options.report is None or options.mcap is not None:
            raise InputError(
                "--all: without --report or with --mcap; expected --report DIR, to which it writes "
                "the bag as well"
            )
        check_parts(options.report)
    if options.report is not None:
        check_writable(options.report)
    for path in (options.save_scene, options.movie, options.pdf):
        if path is not None:
            check_output_path(path)


def _drawings(options: argparse.Namespace) -> tuple[str, ...]:
    """The outputs that need 3D Slicer's scene."""
    paths = {
        PICTURE: options.report or options.pdf,
        SCENE: options.save_scene,
        _movie_kind(options): options.movie,
    }
    return tuple(name for name, path in paths.items() if path is not None)


def _movie_kind(options: argparse.Namespace) -> str:
    is_video = options.movie is not None and options.movie.suffix.lower() == ".mp4"
    return VIDEO if is_video else MOVIE
