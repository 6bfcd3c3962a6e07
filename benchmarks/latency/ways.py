"""The ways from a stamp to the scene: ours, timers as other bridges have them, OpenIGTLink.

A way is asked for one `update` after the other by the thread that owns the scene. It waits for its
turn (something new, or the next tick of its timer) and moves the models. A frame is in the scene
when all of its bodies are.
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
from app.cli.touch_arm import TOUCH_URDF
from app.geometry import NS_PER_S, FloatArray
from app.robot import load_robot
from app.runtime.latest_value import LatestValue
from app.scene import PoseNodes
from app.scene.nodes.models import add_model, smooth_surface
from benchmarks.fixture_shapes import lobed_tumor
from benchmarks.latency.bodies import ROOT, body_frames

_WAIT_S = 0.1
"""How long a way without a timer waits before it says that nothing came."""

_TRIANGLES = 1280


class Models:
    """A scene with a model on a transform node of its own for each of ``frames``."""

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
    """Ticks at ``rate_hz`` on an absolute clock; a tick that was missed is not made up for.

    Its phase walks through one whole period in ``seconds``: sender and timer keep time so well
    that how far they are apart would otherwise be luck, and all of the result.
    """

    def __init__(self, rate_hz: float, seconds: float) -> None:
        period_ns = NS_PER_S / rate_hz
        self._period_ns = period_ns + period_ns / (seconds * rate_hz)
        self._due_ns = float(time.monotonic_ns())

    def wait(self) -> None:
        """Return at the next tick."""
        behind_ns = time.monotonic_ns() - self._due_ns
        self._due_ns += self._period_ns * max(1, math.ceil(behind_ns / self._period_ns))
        time.sleep(max(0.0, self._due_ns - time.monotonic_ns()) / NS_PER_S)


class Way(ABC):
    """One way; ``arrivals_ns`` says when each message came, None where that cannot be known."""

    arrivals_ns: list[int] | None = None

    @abstractmethod
    def update(self) -> int | None:
        """Bring what is new into the scene; the first stamp of the newest whole frame in it."""

    @abstractmethod
    def close(self) -> None:
        """Receive no more."""


class RosWay(Way):
    """What ways by ROS have in common: a node, and a note of what arrives."""

    def __init__(self) -> None:
        self.ros = RosNode("latency_scene")
        self._arrivals_ns: list[int] = []
        self.arrivals_ns = self._arrivals_ns

    def close(self) -> None:
        """Leave the graph."""
        self.ros.close()

    def note_arrival(self) -> None:
        """To be called for every message."""
        self._arrivals_ns.append(time.time_ns())


class WokenByTf(RosWay):
    """Ours: the scene's thread sleeps until a message has been read, and takes the newest poses."""

    def __init__(self, frames: Sequence[str]) -> None:
        super().__init__()
        self.models = Models(frames)
        buffer = TransformBuffer()
        self._latest = LatestPoses(buffer, ROOT, frames)
        TfListener(self.ros, buffer, received=self._received)

    def update(self) -> int | None:
        """As soon as there are newer poses."""
        poses = self._latest.take(_WAIT_S)
        if poses is None:
            return None
        self.models.poses.move(poses.matrices)
        return poses.stamp_ns

    def _received(self) -> None:
        self.note_arrival()
        self._latest.received()


class PolledTf(RosWay):
    """The same listener and buffer, asked for one body after the other whenever a timer ticks."""

    def __init__(self, frames: Sequence[str], timer: Timer) -> None:
        super().__init__()
        self.models = Models(frames)
        self._frames = tuple(frames)
        self._timer = timer
        self._buffer = TransformBuffer()
        TfListener(self.ros, self._buffer, received=self.note_arrival)

    def update(self) -> int | None:
        """At the next tick."""
        self._timer.wait()
        try:
            found = [self._buffer.lookup(ROOT, frame) for frame in self._frames]
        except TfError:
            return None  # before the first message
        self.models.poses.move(np.array([each.transform.matrix for each in found]))
        return whole([each.stamp_ns or 0 for each in found])


class PolledIgtl(Way):
    """pyigtl's client, asked by a timer: Slicer's own OpenIGTLink connector does it at 200 Hz."""

    # The client keeps the last message of a device and does not count them: no arrivals.

    def __init__(self, frames: Sequence[str], timer: Timer, port: int) -> None:
        self.models = Models(frames)
        self._places = {frame: place for place, frame in enumerate(frames)}
        self._timer = timer
        self._matrices: FloatArray = np.tile(np.eye(4), (len(frames), 1, 1))
        self._stamps_ns = [0] * len(frames)
        self._client = OpenIGTLinkClient("127.0.0.1", port)

    def update(self) -> int | None:
        """At the next tick."""
        self._timer.wait()
        for message in self._client.get_latest_messages():
            place = self._places[message.device_name]
            self._matrices[place] = message.matrix
            self._stamps_ns[place] = round(message.timestamp * NS_PER_S)
        self.models.poses.move(self._matrices)
        return whole(self._stamps_ns) or None

    def close(self) -> None:
        """Hang up."""
        self._client.stop()


class WokenByJoints(RosWay):
    """Ours for a robot that tells its joints: forward kinematics, then the links' nodes."""

    def __init__(self) -> None:
        super().__init__()
        robot = load_robot(TOUCH_URDF)
        self.models = Models([link.name for link in robot.links])
        self._news = LatestValue[bool]()
        self._robot = FollowedRobot(
            self.ros,
            RobotSettings(robot.name),
            TransformBuffer(),
            robot,
            joint_states="joint_states",
            received=self._received,
        )

    def update(self) -> int | None:
        """As soon as there are newer joints."""
        if self._news.take(_WAIT_S) is None:
            return None
        state = self._robot.state(time.time_ns())
        if state.poses is None:
            return None
        self.models.poses.move(state.poses)
        return state.stamp_ns

    def _received(self) -> None:
        self.note_arrival()
        self._news.put(True)


def whole(stamps_ns: Sequence[int]) -> int | None:
    """The first body's stamp, unless another body is still that of an earlier frame."""
    return stamps_ns[0] if min(stamps_ns) >= stamps_ns[0] else None


@dataclass(frozen=True, slots=True)
class Kind:
    """A row of the table: what is sent at which rate, and how it comes into the scene."""

    name: str
    what: str
    sends: str
    rate_hz: float
    poll_hz: float | None = None

    def open(self, bodies: int, seconds: float, port: int | None) -> Way:
        """The way, ready to receive; its timer's phase walks through a period in ``seconds``."""
        frames = body_frames(bodies)
        if self.sends == "joints":
            return WokenByJoints()
        if self.poll_hz is None:
            return WokenByTf(frames)
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
