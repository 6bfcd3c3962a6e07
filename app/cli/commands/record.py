"""Record ROS 2 topics into a case: a rosbag2 folder in MCAP, which 'replay' reads.

With --config also what an OpenIGTLink source sends, images included. The recording stays readable
however it ends, also by SIGKILL or on a full disk. Runs until SIGINT (exit status 130) or SIGTERM
(143); exit status 2 on bad input.
"""

import argparse
import json
import shutil
import sys
import threading
import time
from contextlib import ExitStack, closing
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

from app.cli.options import add_json, add_namespace, add_package_dirs, folder_path, input_argument
from app.cli.process import note_signals
from app.cli.ros import load_ros
from app.geometry import InputError

if TYPE_CHECKING:
    from typing import BinaryIO

    from app.bridge import RosNode
    from app.bridge.live.ros_recorder import RosRecorder
    from app.case import BagWriter, LiveCase, SessionValues

SUMMARY = "record a live case over ROS 2"

PLAYBACK = "/marginguard_tracker/playback"
"""Announces that the poses are those of a recording: it stays visible in a new recording."""

TRACKED = "/tracked_transforms"
TOPICS = ("/tf", "/tf_static", TRACKED, "/joint_states", PLAYBACK)
CONSTRAINT = "/marginguard/constraint"
SESSION_TOPICS = (CONSTRAINT, "/marginguard/margin_mm")
MARKERS = "/marginguard/markers"
"""Holds the tumour's surface; recorded once a session has replaced its tumour."""

_POLL_S = 0.1
"""Interval between looks at the graph for new topics and publishers."""

_MAX_INPUT_BYTES = 4096
"""Longest line of standard input."""

_STATUS_POLLS = 5
"""Looks between two lines of ``--json``."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard record``."""
    parser.add_argument(
        "-o",
        "--output",
        type=folder_path,
        required=True,
        metavar="CASE",
        help="new folder; the recording is CASE/tracking, a rosbag2 folder",
    )
    parser.add_argument(
        "--config",
        type=input_argument,
        metavar="FILE",
        help="live.yaml: write case.yaml and the meshes too, so that 'replay CASE' works",
    )
    add_package_dirs(parser)
    parser.add_argument(
        "--topics",
        nargs="+",
        metavar="TOPIC",
        help=f"record these instead of {', '.join(TOPICS + SESSION_TOPICS)}; full names",
    )
    add_namespace(parser)
    parser.add_argument(
        "--until-eof",
        action="store_true",
        help="for the program that starts it: also end, with exit status 0, when standard input "
        'ends; a line {"replaced": ["tip"]} of it is noted in the recording, one '
        '{"image_depth": [40.0, 123]}, in mm and ns, is written to it',
    )
    parser.add_argument(
        "--session-values",
        action="store_true",
        help="for a live session: with --until-eof and --config, standard input begins with the "
        "structures, tip, registration and margins that it uses at present; the case has these",
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Record until a signal arrives."""
    with note_signals() as received:
        stop, notes = threading.Event(), SimpleQueue[dict[str, Any]]()
        received.stops(stop.set)
        given = sys.stdin.buffer if options.until_eof else None
        values = _session_values(options, given)
        if given is not None:
            threading.Thread(target=_read_input, args=(given, stop, notes), daemon=True).start()
        topics, live = _topics_and_case(options)
        load_ros("which 'record' needs")
        from app.bridge import RosNode
        from app.case import RECORDING_FOLDER, BagWriter, begin_case

        lines = _Lines(as_json=options.json)
        # Create the node first: where ROS refuses it, no folder is left.
        with RosNode("marginguard_recorder", namespace=options.namespace) as ros:
            if live is not None:
                begin_case(live, options.output, values)
            try:
                bag = BagWriter(options.output / RECORDING_FOLDER)
            except InputError:
                # Nothing was there before: `_topics_and_case` has checked it.
                shutil.rmtree(options.output, ignore_errors=True)
                raise
            # The node is closed before the bag, so that no message arrives for a closed bag.
            with closing(bag), ros:
                _record(ros, bag, topics, stop, notes, options, live, values, lines)
        counts = bag.counts
        lines.note(f"{sum(counts.values())} messages of {len(counts)} topics in {options.output}")
        for topic, count in counts.items():
            lines.note(f"  {topic}: {count}")
    return received.exit_status


def _session_values(
    options: argparse.Namespace, given: "BinaryIO | None"
) -> "SessionValues | None":
    """Those that begin standard input, None without ``--session-values``."""
    if not options.session_values:
        return None
    from app.case import received_values

    if given is None or options.config is None:
        raise InputError("--session-values: expected --until-eof and --config with it")
    return received_values(given)


def _read_input(
    given: "BinaryIO", stop: threading.Event, notes: "SimpleQueue[dict[str, Any]]"
) -> None:
    """Pass on each line of standard input that is an object, until its end."""
    while line := given.readline(_MAX_INPUT_BYTES):
        try:
            values = json.loads(line)
        except ValueError:
            continue
        if isinstance(values, dict):
            notes.put(values)
    stop.set()


class _Lines:
    """Prints notes, and with ``as_json`` each as an object ``{"note": ...}`` and the status."""

    def __init__(self, *, as_json: bool) -> None:
        self._as_json = as_json
        self._begin_s = time.monotonic()

    def note(self, text: str, *, problem: bool = False) -> None:
        """Print one line; a ``problem`` without JSON on standard error."""
        if self._as_json:
            print(json.dumps({"note": text.strip()}), flush=True)
        else:
            print(text, file=sys.stderr if problem else sys.stdout, flush=True)

    def status(self, recorder: "RosRecorder", bag: "BagWriter", problem: str) -> None:
        """Print what was recorded so far, with ``as_json`` only."""
        if not self._as_json:
            return
        counts = bag.counts
        values = {
            "duration_s": round(time.monotonic() - self._begin_s, 3),
            "messages": sum(counts.values()),
            "lost": recorder.lost,
            "topics": counts,
            "waiting": list(recorder.waiting),
            "problem": problem,
        }
        print(json.dumps({"status": values}), flush=True)


def _topics_and_case(options: argparse.Namespace) -> tuple[list[str], "LiveCase | None"]:
    """The topics to record, and the live case, None without ``--config``."""
    from app.case import check_topic, open_live
    from app.case.live_file import IgtlSourceEntry

    topics = [check_topic(topic, "--topics") for topic in options.topics or ()]
    if not topics:
        topics = [*TOPICS, *(_session_topic(topic, options) for topic in SESSION_TOPICS)]
    if options.output.exists():
        raise InputError(f"{options.output} already exists; refusing to overwrite it")
    if options.config is None:
        return topics, None
    live = open_live(options.config, package_dirs=options.package_dirs)
    if isinstance(live.source, IgtlSourceEntry):
        topics = [each for each in topics if each != TRACKED]  # those of the server are written
    images = live.case.manifest.images
    if images is not None and images.topic is not None:
        topics.append(images.topic)
    activation = live.case.manifest.activation
    if activation is not None and activation.topic is not None:
        topics.append(activation.topic)
    robot = live.case.manifest.robot
    if robot is not None and robot.joint_states is not None:
        topics.append(robot.joint_states)
    return topics, live


def _session_topic(name: str, options: argparse.Namespace) -> str:
    """The topic ``name`` in the namespace of the session's node."""
    namespace = str(options.namespace).strip("/")
    return f"/{namespace}{name}" if namespace else name


def _record(
    ros: "RosNode",
    bag: "BagWriter",
    topics: list[str],
    stop: threading.Event,
    notes: "SimpleQueue[dict[str, Any]]",
    options: argparse.Namespace,
    live: "LiveCase | None",
    values: "SessionValues | None",
    lines: _Lines,
) -> None:
    from app.bridge import BridgeError
    from app.bridge.live.non_ros_recorder import DepthRecorder, IgtlRecorder
    from app.bridge.live.ros_recorder import RosRecorder, SessionWatch
    from app.case import RECORDING_FOLDER
    from app.case.bag_writer import PeriodicFlush
    from app.case.live_file import IgtlSourceEntry
    from app.case.new_case import write_changes

    constraint = _session_topic(CONSTRAINT, options)
    of_patient = live is not None and live.case.manifest.provenance.kind == "recorded"
    session = SessionWatch()
    recorder = RosRecorder(ros, bag, topics)

    depths = None if live is None else DepthRecorder.of(recorder, live, values)

    def take_notes() -> None:
        while not notes.empty():
            note = notes.get()
            if depths is not None and "image_depth" in note:
                lines.note(depths.write(*note["image_depth"]))
            if "replaced" not in note:
                continue
            parts = ", ".join(map(str, note["replaced"]))
            lines.note(f"replaced in the session: {parts}")
            session.note_replaced(time.time_ns(), parts)
            write_changes(session.changes, options.output / RECORDING_FOLDER)
            recorder.add(_session_topic(MARKERS, options))

    with PeriodicFlush(recorder.flush, recorder.sync), ExitStack() as stack:
        server = None
        if live is not None and isinstance(live.source, IgtlSourceEntry):
            server = IgtlRecorder(recorder, live, live.source, depths, lines.note)
            stack.callback(server.close)
        polls = 0
        while not stop.wait(_POLL_S if polls else 0.0):
            if of_patient and ros.node.count_publishers(PLAYBACK):
                raise BridgeError(
                    f"a recording is played on this graph; {options.output} is closed and may hold "
                    "its first samples; expected provenance.kind 'simulated' in "
                    f"{options.config}"
                )
            for topic in recorder.discover():
                lines.note(f"recording {topic}")
            for topic in [*recorder.refused]:
                reason = recorder.refused.pop(topic)
                lines.note(f"{topic} is not recorded: {reason}", problem=True)
            publishers = ros.node.count_publishers(constraint) if constraint in topics else 0
            if session.has_new_publisher(publishers):
                lines.note(
                    f"{constraint} has {publishers} publishers; several sessions may be running"
                )
            if session.has_changed(recorder.last(constraint)):
                lines.note("tumour or registration of the session were replaced")
                write_changes(session.changes, options.output / RECORDING_FOLDER)
                recorder.add(_session_topic(MARKERS, options))
            take_notes()
            recorder.flush()  # raises an error of the bag
            if polls % _STATUS_POLLS == 0:
                lines.status(recorder, bag, "" if server is None else server.problem)
            polls += 1
        take_notes()
    lines.status(recorder, bag, "")
