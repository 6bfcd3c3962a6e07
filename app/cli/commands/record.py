"""Record ROS 2 topics into a case: a rosbag2 folder in MCAP, which 'replay' reads.

The recording stays readable however it ends, also by SIGKILL or on a full disk. Runs until SIGINT
(exit status 130) or SIGTERM (143); exit status 2 on bad input.
"""

import argparse
import sys
import threading
from contextlib import closing
from typing import TYPE_CHECKING

from app.cli.options import add_namespace, add_package_dirs, folder_path, input_argument
from app.cli.ros import load_bridge, print_reach
from app.cli.signals import note_signals

if TYPE_CHECKING:
    from app.bridge import RosNode
    from app.case import BagWriter, LiveCase

SUMMARY = "record a live case over ROS 2"

PLAYBACK = "/marginguard_tracker/playback"
"""Announces that the poses are those of a recording: it stays visible in a new recording."""

TOPICS = ("/tf", "/tf_static", "/tracked_transforms", "/joint_states", PLAYBACK)
CONSTRAINT = "/marginguard/constraint"
SESSION_TOPICS = (CONSTRAINT, "/marginguard/margin_mm")
MARKERS = "/marginguard/markers"
"""Holds the tumour's surface; recorded once a session has replaced its tumour."""

_POLL_S = 0.1
"""Interval between looks at the graph for new topics and publishers."""


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


def run(options: argparse.Namespace) -> int:
    """Record until a signal arrives."""
    with note_signals() as received:
        stop = threading.Event()
        received.stops(stop.set)
        topics, live = _topics_and_case(options)
        load_bridge("which 'record' needs")
        print_reach()
        from app.bridge import RosNode
        from app.case import RECORDING_FOLDER, BagWriter, begin_case

        # Create the node first: where ROS refuses it, no folder is left.
        with RosNode("marginguard_recorder", namespace=options.namespace) as ros:
            if live is not None:
                begin_case(live, options.output)
            # The node is closed before the bag, so that no message arrives for a closed bag.
            with closing(BagWriter(options.output / RECORDING_FOLDER)) as bag, ros:
                of_patient = live is not None and live.case.manifest.provenance.kind == "recorded"
                _record(ros, bag, topics, stop, options, of_patient=of_patient)
        counts = bag.counts
        print(f"{sum(counts.values())} messages of {len(counts)} topics in {options.output}")
        for topic, count in counts.items():
            print(f"  {topic}: {count}")
    return received.exit_status


def _topics_and_case(options: argparse.Namespace) -> tuple[list[str], "LiveCase | None"]:
    """The topics to record, and the live case, None without ``--config``."""
    from app.case import check_topic, open_live
    from app.geometry import InputError

    topics = [check_topic(topic, "--topics") for topic in options.topics or ()]
    if not topics:
        topics = [*TOPICS, *(_session_topic(topic, options) for topic in SESSION_TOPICS)]
    if options.output.exists():
        raise InputError(f"{options.output} already exists; refusing to overwrite it")
    if options.config is None:
        return topics, None
    live = open_live(options.config, package_dirs=options.package_dirs)
    images = live.case.manifest.images
    if images is not None and images.topic is not None:
        topics.append(images.topic)
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
    options: argparse.Namespace,
    *,
    of_patient: bool,
) -> None:
    from app.bridge import BridgeError
    from app.bridge.live import RosRecorder, SessionWatch
    from app.case import RECORDING_FOLDER
    from app.case.live_recording import write_changes
    from app.case.recorder.periodic_flush import PeriodicFlush

    constraint = _session_topic(CONSTRAINT, options)
    session = SessionWatch()
    recorder = RosRecorder(ros, bag, topics)
    with PeriodicFlush(recorder.flush, recorder.sync):
        while not stop.wait(_POLL_S):
            if of_patient and ros.node.count_publishers(PLAYBACK):
                raise BridgeError(
                    f"a recording is played on this graph; {options.output} is closed and may hold "
                    "its first samples; expected provenance.kind 'simulated' in "
                    f"{options.config}"
                )
            for topic in recorder.discover():
                print(f"recording {topic}", flush=True)
            for topic in [*recorder.refused]:
                print(f"{topic} is not recorded: {recorder.refused.pop(topic)}", file=sys.stderr)
            publishers = ros.node.count_publishers(constraint) if constraint in topics else 0
            if session.has_new_publisher(publishers):
                print(
                    f"{constraint} has {publishers} publishers; several sessions may be running",
                    flush=True,
                )
            if session.has_changed(recorder.last(constraint)):
                print("tumour or registration of the session were replaced", flush=True)
                write_changes(session.changes, options.output / RECORDING_FOLDER)
                recorder.add(_session_topic(MARKERS, options))
            recorder.flush()  # raises an error of the bag
