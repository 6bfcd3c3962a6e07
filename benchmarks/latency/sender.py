"""Process of `benchmarks.latency` that sends moving bodies, stamped on creation.

    python -m benchmarks.latency.sender tf|igtl BODIES RATE_HZ WARM_UP_S SECONDS

Prints its port (OpenIGTLink) on standard output, waits for its only receiver, sends at the given
rate on an absolute clock, and prints the number of frames sent after the warm-up. A body's stamp is
the system's clock when the body is created.
"""

import json
import sys
import time
from contextlib import ExitStack
from typing import Protocol

from pyigtl import OpenIGTLinkServer, TransformMessage

from app.bridge import RosNode, prepare_environment, topics
from app.bridge.qos import Topic
from app.bridge.tf.pose import matrices
from app.bridge.tf.wire import TfSample, write_tf_message
from app.geometry import NS_PER_S
from benchmarks.latency.bodies import ROOT, body_frames, body_pose

_CONNECT_TIMEOUT_S = 60.0
_ROUNDING_NS = 10_000
"""pyigtl's stamps are numbers of seconds in floating point; creating a frame takes longer."""
_DRAIN_TIME_S = 0.3
"""pyigtl sends from a thread of its own and drops unsent messages when it is stopped."""


class Output(Protocol):
    """Output of frames; ``port`` is its TCP port, None on the ROS graph."""

    port: int | None

    def wait_for_receiver(self) -> bool:
        """Wait for a receiver; False after the timeout."""

    def send(self, frame: int) -> int:
        """Create and send a frame; returns the stamp of its first body."""


class RosOutput:
    """Base of the ROS outputs: a publisher on ``topic``."""

    port = None

    def __init__(self, topic: Topic, stack: ExitStack) -> None:
        self._topic = topic
        self._ros = stack.enter_context(RosNode("latency_sender"))
        self.publisher = self._ros.publisher(topic)

    def wait_for_receiver(self) -> bool:
        """Wait for a subscriber."""
        return self._ros.wait_for_subscribers(self._topic, 1, _CONNECT_TIMEOUT_S)


class TfOutput(RosOutput):
    """All bodies in one message on ``/tf``, sent as bytes."""

    def __init__(self, bodies: int, stack: ExitStack) -> None:
        super().__init__(topics.TF, stack)
        self._frames = body_frames(bodies)

    def send(self, frame: int) -> int:
        """Send one message."""
        samples = [
            TfSample(ROOT, name, time.time_ns(), body_pose(body, frame))
            for body, name in enumerate(self._frames)
        ]
        self.publisher.publish(write_tf_message(samples))
        return samples[0].stamp_ns


class IgtlOutput:
    """One TRANSFORM message per body, from pyigtl's server."""

    def __init__(self, bodies: int, stack: ExitStack) -> None:
        self._frames = body_frames(bodies)
        self._server = OpenIGTLinkServer(port=0, local_server=True)
        stack.callback(self._server.stop)
        self.port: int | None = self._server.server_address[1]

    def wait_for_receiver(self) -> bool:
        """Wait for a client by polling, pyigtl's only interface."""
        until_s = time.monotonic() + _CONNECT_TIMEOUT_S
        while not self._server.is_connected() and time.monotonic() < until_s:
            time.sleep(0.01)
        return bool(self._server.is_connected())

    def send(self, frame: int) -> int:
        """Send one message per body."""
        first_ns = 0
        for body, name in enumerate(self._frames):
            stamp_ns = time.time_ns()
            first_ns = first_ns or stamp_ns
            (matrix,) = matrices([body_pose(body, frame)])
            message = TransformMessage(matrix, device_name=name, timestamp=stamp_ns / NS_PER_S)
            self._server.send_message(message, wait=False)
        return first_ns


def main() -> int:
    prepare_environment()
    kind, bodies = sys.argv[1], int(sys.argv[2])
    rate_hz, warm_up_s, seconds = (float(text) for text in sys.argv[3:])
    period_ns = round(NS_PER_S / rate_hz)
    warm_up, counted = round(warm_up_s * rate_hz), round(seconds * rate_hz)
    counted_from_ns = 0
    with ExitStack() as stack:
        output: Output
        output = (IgtlOutput if kind == "igtl" else TfOutput)(bodies, stack)
        print(json.dumps({"port": output.port}), flush=True)
        if not output.wait_for_receiver():
            raise RuntimeError(f"no receiver of {kind} within {_CONNECT_TIMEOUT_S:.0f} s")
        begin_ns = time.monotonic_ns()
        for frame in range(warm_up + counted):
            ahead_ns = begin_ns + frame * period_ns - time.monotonic_ns()
            if ahead_ns > 0:
                time.sleep(ahead_ns / NS_PER_S)
            stamp_ns = output.send(frame)
            if frame == warm_up:
                counted_from_ns = stamp_ns - _ROUNDING_NS
        time.sleep(_DRAIN_TIME_S)
    print(json.dumps({"sent": counted, "counted_from_ns": counted_from_ns}), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
