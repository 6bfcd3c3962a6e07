"""Receivers that bring poses into the scene: ours, timers as in other bridges, OpenIGTLink.

The scene's thread calls `Receiver.update` repeatedly. Each call waits (for new data, or for the
next tick of a timer) and moves the models. A frame is in the scene when all of its bodies are.
"""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pyigtl import OpenIGTLinkClient
from slicer import vtkMRMLScene

from app.bridge import RosNode
from app.bridge.robots import FollowedRobot, RobotSettings
from app.bridge.tf import TfError, TransformBuffer
from app.bridge.tf.latest import LatestPoses
from app.bridge.tf.listener import TfListener
from app.geometry import NS_PER_S, FloatArray
from app.robot import load_robot
from app.runtime.latest_value import LatestValue
from app.scene import PoseNodes
from app.scene.nodes.models import add_model, smooth_surface
from app.synthetic.touch_arm import TOUCH_URDF
from benchmarks.fixture_shapes import lobed_tumor
from benchmarks.latency.bodies import ROOT, body_frames

_WAIT_S = 0.1
"""Timeout of a receiver without a timer."""

_TRIANGLES = 1280


class Models:
    """A scene with one model per frame, each on a transform node of its own."""

    def __init__(self, frames: Sequence[str]) -> None:
        self.scene = vtkMRMLScene()
        self.poses = PoseNodes(self.scene, ROOT, frames)
        surface = smooth_surface(lobed_tumor(_TRIANGLES))
        self.models = {
            frame: add_model(
                self.scene,
                f"{frame}_model",
                surface,
                (0.7, 0.7, 0.7),
                parent=self.poses.nodes[frame],
            )
            for frame in frames
        }


class Timer:
    """Ticks at ``rate_hz`` on an absolute clock; missed ticks are skipped.

    Its phase drifts through one period in ``seconds``. Otherwise the constant phase between sender
    and timer, which is random, would determine the result.
    """

    def __init__(self, rate_hz: float, seconds: float) -> None:
        period_ns = NS_PER_S / rate_hz
        self._period_ns = period_ns + period_ns / (seconds * rate_hz)
        self._due_ns = float(time.monotonic_ns())

    def wait(self) -> None:
        """Wait for the next tick."""
        behind_ns = time.monotonic_ns() - self._due_ns
        self._due_ns += self._period_ns * max(1, math.ceil(behind_ns / self._period_ns))
        time.sleep(max(0.0, self._due_ns - time.monotonic_ns()) / NS_PER_S)


class Receiver(ABC):
    """Base of the receivers; ``arrivals_ns``: times of arrival, None if they are not known."""

    arrivals_ns: list[int] | None = None

    @abstractmethod
    def update(self) -> int | None:
        """Update the scene; returns the first stamp of its newest complete frame, or None."""

    @abstractmethod
    def close(self) -> None:
        """Stop receiving."""


class RosReceiver(Receiver):
    """Base of the ROS receivers: a node, and the times of arrival."""

    def __init__(self) -> None:
        self.ros = RosNode("latency_scene")
        self._arrivals_ns: list[int] = []
        self.arrivals_ns = self._arrivals_ns

    def close(self) -> None:
        """Leave the graph."""
        self.ros.close()

    def record_arrival(self) -> None:
        """Record the arrival of a message."""
        self._arrivals_ns.append(time.time_ns())


class EventDrivenTf(RosReceiver):
    """Ours: the scene's thread sleeps until a message is received and takes the newest poses."""

    def __init__(self, frames: Sequence[str]) -> None:
        super().__init__()
        self.models = Models(frames)
        buffer = TransformBuffer()
        self._latest = LatestPoses(buffer, ROOT, frames)
        TfListener(self.ros, buffer, received=self._received)

    def update(self) -> int | None:
        """Wait for newer poses, then move the models."""
        poses = self._latest.take(_WAIT_S)
        if poses is None:
            return None
        self.models.poses.move(poses.matrices)
        return poses.stamp_ns

    def _received(self) -> None:
        self.record_arrival()
        self._latest.received()


class PolledTf(RosReceiver):
    """The same listener and buffer; looks up one body after the other at every tick."""

    def __init__(self, frames: Sequence[str], timer: Timer) -> None:
        super().__init__()
        self.models = Models(frames)
        self._frames = tuple(frames)
        self._timer = timer
        self._buffer = TransformBuffer()
        TfListener(self.ros, self._buffer, received=self.record_arrival)

    def update(self) -> int | None:
        """Wait for the next tick, then move the models."""
        self._timer.wait()
        try:
            found = [self._buffer.lookup(ROOT, frame) for frame in self._frames]
        except TfError:
            return None  # before the first message
        self.models.poses.move(np.array([each.transform.matrix for each in found]))
        return complete_frame_stamp([each.stamp_ns or 0 for each in found])


class PolledIgtl(Receiver):
    """pyigtl's client, polled by a timer like Slicer's OpenIGTLink connector (200 Hz)."""

    # No arrivals: the client keeps only the last message of a device and does not count.

    def __init__(self, frames: Sequence[str], timer: Timer, port: int) -> None:
        self.models = Models(frames)
        self._indices = {frame: index for index, frame in enumerate(frames)}
        self._timer = timer
        self._matrices: FloatArray = np.tile(np.eye(4), (len(frames), 1, 1))
        self._stamps_ns = [0] * len(frames)
        self._client = OpenIGTLinkClient("127.0.0.1", port)

    def update(self) -> int | None:
        """Wait for the next tick, then move the models."""
        self._timer.wait()
        for message in self._client.get_latest_messages():
            index = self._indices[message.device_name]
            self._matrices[index] = message.matrix
            self._stamps_ns[index] = round(message.timestamp * NS_PER_S)
        self.models.poses.move(self._matrices)
        return complete_frame_stamp(self._stamps_ns) or None

    def close(self) -> None:
        """Disconnect."""
        self._client.stop()


class EventDrivenJoints(RosReceiver):
    """Ours for a robot with joint states: forward kinematics, then the links' nodes."""

    def __init__(self) -> None:
        super().__init__()
        robot = load_robot(TOUCH_URDF)
        self.models = Models([link.name for link in robot.links])
        self._changed = LatestValue[bool]()
        self._robot = FollowedRobot(
            self.ros,
            RobotSettings(robot.name),
            TransformBuffer(),
            robot,
            joint_states="joint_states",
            received=self._received,
        )

    def update(self) -> int | None:
        """Wait for newer joints, then move the models."""
        if self._changed.take(_WAIT_S) is None:
            return None
        state = self._robot.state(time.time_ns())
        if state.poses is None:
            return None
        self.models.poses.move(state.poses)
        return state.stamp_ns

    def _received(self) -> None:
        self.record_arrival()
        self._changed.put(True)


def complete_frame_stamp(stamps_ns: Sequence[int]) -> int | None:
    """The first body's stamp; None if another body still belongs to an earlier frame."""
    return stamps_ns[0] if min(stamps_ns) >= stamps_ns[0] else None


@dataclass(frozen=True, slots=True)
class Kind:
    """A row of the table: content, rate and receiver."""

    name: str
    what: str
    sends: str
    rate_hz: float
    poll_hz: float | None = None

    def open(self, bodies: int, seconds: float, port: int | None) -> Receiver:
        """The receiver; the phase of its timer drifts through a period in ``seconds``."""
        frames = body_frames(bodies)
        if self.sends == "joints":
            return EventDrivenJoints()
        if self.poll_hz is None:
            return EventDrivenTf(frames)
        timer = Timer(self.poll_hz, seconds)
        return PolledTf(frames, timer) if port is None else PolledIgtl(frames, timer, port)


OURS = "marginguard"
POLLED = "timer 200 Hz"
KINDS = (
    Kind(OURS, "tf, woken by each message", "tf", 200.0),
    Kind(POLLED, "tf, all looked up at every tick", "tf", 200.0, poll_hz=200.0),
    Kind("timer 100 Hz", "tf, all looked up at every tick", "tf", 200.0, poll_hz=100.0),
    Kind("OpenIGTLink", "pyigtl, asked at 200 Hz", "igtl", 200.0, poll_hz=200.0),
    Kind("joints", "joint states at 100 Hz, 7 links", "joints", 100.0),
)
