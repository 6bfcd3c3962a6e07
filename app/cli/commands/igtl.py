"""Receive transforms from an OpenIGTLink server (PLUS) and publish them over ROS 2.

Every TRANSFORM and every element of TDATA is published on /tracked_transforms with the status and
the time stamp of the server, good ones on /tf as well; --images publishes the images of one device,
too. The state of the connection and the count of refused messages are published on /diagnostics.
After a lost connection it reconnects until a signal ends it.
"""

import argparse
import sys
import time
from contextlib import ExitStack

from app.cli.ros import load_bridge, print_reach
from app.cli.signals import note_signals

SUMMARY = "publish the transforms of an OpenIGTLink server (PLUS) over ROS 2"

_REPORT_S = 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard igtl``."""
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


def run(options: argparse.Namespace) -> int:
    """Publish until a signal comes."""
    from app.case import check_topic
    from app.geometry import InputError

    if options.images is not None:
        check_topic(options.images, "--images")
    elif options.device is not None:
        raise InputError("--device is given without --images; expected both")
    with note_signals() as received:
        load_bridge("which 'igtl' needs")
        print_reach()
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
