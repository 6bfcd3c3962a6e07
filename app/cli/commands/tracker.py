"""Play the recorded poses and joints of a case onto the ROS graph, as a tracker and a robot would.

For a live session without a tracker: start 'live' or 'view --live' in another terminal, with a
live.yaml whose provenance.kind is simulated. Stamps are those of now, with the recorded intervals
and the recorded offset of the robot's clock; every status is as recorded. It runs no session and
publishes no constraint. It refuses to start, and stops, when another node publishes poses or joints
too, and it announces itself on /marginguard_tracker/playback and /diagnostics. Exit status 0 at the
end of the recording, 2 on bad input or another publisher, 130 or 143 after a signal.
"""

import argparse
import sys
import threading
import time
from contextlib import ExitStack

from app.cli.options import add_case
from app.cli.parsing import CommandParser
from app.cli.process import note_signals
from app.cli.ros import load_ros
from app.geometry import InputError

SUMMARY = "publish the poses of a case, or of an OpenIGTLink server (PLUS), over ROS 2"


def add_arguments(parser: CommandParser) -> None:
    """Declare the options of ``marginguard tracker``."""
    add_case(parser)
    parser.add_argument(
        "--rate",
        type=float,
        default=1.0,
        metavar="R",
        help="1 is real time, 2 twice as fast, with intervals half as long; default: 1",
    )
    parser.add_argument("--loop", action="store_true", help="start again at the end, after a pause")
    parser.add_argument(
        "--start",
        type=float,
        default=0.0,
        metavar="S",
        help="start this many seconds after the first sample, in every pass; default: 0",
    )
    parser.add_argument(
        "--topic",
        default="/tracked_transforms",
        metavar="TOPIC",
        help="topic of the poses (marginguard_msgs/TrackedTransform); default: %(default)s",
    )
    _add_igtl_arguments(
        parser.add_subcommand(
            "igtl",
            _run_igtl,
            "publish the transforms of an OpenIGTLink server (PLUS) over ROS 2",
        )
    )


def run(options: argparse.Namespace) -> int:
    """Play until the recording ends, a signal arrives or another publisher appears."""
    with note_signals() as received:
        from app.case import check_topic
        from app.case.player import checked_rate

        topic = check_topic(options.topic, "--topic")
        checked_rate(options.rate)
        load_ros("which 'tracker' needs")
        with received.ends_at_once():
            from app.bridge import RosNode
            from app.bridge.playback import NODE_NAME, PlaybackNode
            from app.runtime import open_recording, playback_of

            case = open_recording(options.case, package_dirs=options.package_dirs)
            playback = playback_of(
                case,
                clock_ns=time.monotonic_ns,
                host_ns=time.time_ns,
                rate=options.rate,
                loop=options.loop,
                start_s=options.start,
            )
        stop = threading.Event()

        def end() -> None:
            stop.set()
            playback.stop()

        received.stops(end)
        manifest = case.manifest
        with RosNode(NODE_NAME) as ros:
            node = PlaybackNode(ros, manifest, topic)
            print("looking for other publishers", flush=True)
            if node.start(stop):
                names = ", ".join(node.topic_names)
                print(f"PLAYBACK of {manifest.name} on {names}; Ctrl-C ends it", flush=True)
                for samples in playback.play():
                    node.publish(samples)
                print(f"played {node.poses} poses and {node.joints} joint samples", flush=True)
    return received.exit_status


_REPORT_S = 1.0


def _add_igtl_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard tracker igtl``."""
    parser.add_argument(
        "--host", default="localhost", help="the server's name or address (%(default)s)"
    )
    parser.add_argument("--port", type=int, default=18944, help="its port (%(default)s)")
    parser.add_argument(
        "--images", metavar="TOPIC",
        help="publish the server's images, too: on TOPIC, as sensor_msgs/Image",
    )  # fmt: skip
    parser.add_argument(
        "--device", metavar="NAME", help="device of --images; by default that of the first image"
    )
    parser.add_argument(
        "--name", default="marginguard_igtl", help="name of the ROS node (%(default)s)"
    )


def _run_igtl(options: argparse.Namespace) -> int:
    """Receive transforms from an OpenIGTLink server (PLUS) and publish them over ROS 2.

    Every TRANSFORM and every element of TDATA is published on /tracked_transforms with the status
    and the time stamp of the server, good ones on /tf as well; --images publishes the images of one
    device, too. The state of the connection and the count of refused messages are published on
    /diagnostics. After a lost connection it reconnects until a signal ends it.
    """
    from app.case import check_topic

    if options.images is not None:
        check_topic(options.images, "--images")
    elif options.device is not None:
        raise InputError("--device is given without --images; expected both")
    with note_signals() as received:
        load_ros("which 'tracker igtl' needs")
        from app.bridge import RosNode
        from app.bridge.tracker_publisher import IgtlImagePublisher, IgtlPublisher
        from app.igtl import IgtlSource, SampleQueue

        queue = SampleQueue()

        def changed(message: str) -> None:
            # Samples from before a lost connection are old when the next one is made.
            queue.clear()
            print(message, file=sys.stderr, flush=True)

        received.stops(queue.close)
        with RosNode(options.name) as ros, ExitStack() as stack:
            publisher = IgtlPublisher(ros)
            images = None
            if options.images is not None:
                found = IgtlImagePublisher(ros, options.images, options.device, _print_refusal)
                stack.callback(found.close)
                images = found.receive
            address = options.host, options.port
            with IgtlSource(*address, queue.put, changed=changed, images=images) as source:
                due_s = time.monotonic()
                while (samples := queue.take(max(0.0, due_s - time.monotonic()))) is not None:
                    publisher.publish(samples)
                    if time.monotonic() >= due_s:
                        publisher.report(source, queue.superseded)
                        due_s = time.monotonic() + _REPORT_S
    return received.exit_status


def _print_refusal(problem: str) -> None:
    print(f"image not published: {problem}", file=sys.stderr, flush=True)
