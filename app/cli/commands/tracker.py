"""Play the recorded poses and joints of a case onto the ROS graph, as a tracker and a robot would.

For a live session without a tracker: start 'live' or 'view --live' in another terminal, with a
live.yaml whose provenance.kind is simulated. Stamps are those of now, with the recorded intervals
and the recorded offset of the robot's clock; every status is as recorded. It runs no session and
publishes no constraint. It refuses to start, and stops, when another node publishes poses or joints
too, and it announces itself on /marginguard_tracker/playback and /diagnostics. Exit status 0 at the
end of the recording, 2 on bad input or another publisher, 130 or 143 after a signal.
"""

import argparse
import threading
import time

from app.cli.options import add_case
from app.cli.ros import load_bridge, print_reach
from app.cli.signals import note_signals

SUMMARY = "play a case onto the ROS graph as a live tracker and robot"


def add_arguments(parser: argparse.ArgumentParser) -> None:
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


def run(options: argparse.Namespace) -> int:
    """Play until the recording ends, a signal arrives or another publisher appears."""
    with note_signals() as received:
        from app.case import check_topic
        from app.case.player import checked_rate

        topic = check_topic(options.topic, "--topic")
        checked_rate(options.rate)
        load_bridge("which 'tracker' needs")
        print_reach()
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
