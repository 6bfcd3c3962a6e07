"""Receivers of the bodies: the base of all, a plain rclpy listener, and OpenIGTLink's client."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import rclpy
from pyigtl import OpenIGTLinkClient
from slicer import vtkMRMLScene, vtkMRMLTransformNode
from tf2_msgs.msg import TFMessage

from app.geometry import NS_PER_S, FloatArray
from app.scene import PoseNodes
from app.scene.models import add_model, smooth_surface
from benchmarks.fixture_shapes import lobed_tumor
from benchmarks.latency.senders import ROOT, body_frames

RELEASED, KEPT = "lock released", "lock kept"
"""Names of the loops of `benchmarks.latency.qt_loops`, which loads Qt."""

_TRIANGLES = 1280
_PAUSE_S = 0.05
_POLL_NS = NS_PER_S // 200


@dataclass(frozen=True, slots=True)
class Waking:
    """Wake-up of Qt's thread for a message: ``timer_ms`` None is the product's `QtSpinner`."""

    loop: str
    timer_ms: int | None = None


class Receiver(ABC):
    """Receives until the sender has ended.

    ``rows``: stamp of each frame that was complete, and when it was, in ns. ``arrivals_ns``: when
    messages arrived in this process; None if that is not known. ``pictures``: as ``rows``, for
    drawn pictures. ``steps``: as ``rows``, when the session had taken its step.
    """

    def __init__(self) -> None:
        self.rows: list[tuple[int, int]] = []
        self.pictures: list[tuple[int, int]] = []
        self.steps: list[tuple[int, int]] = []
        self.arrivals_ns: list[int] | None = None

    @abstractmethod
    def run(self, has_ended: Callable[[], bool]) -> None:
        """Receive until ``has_ended()``."""

    @abstractmethod
    def close(self) -> None:
        """Stop receiving."""

    def add_row(self, stamp_ns: int | None, now_ns: int) -> None:
        """Add a complete frame, if it is another one than the last."""
        if stamp_ns is not None and (not self.rows or stamp_ns != self.rows[-1][0]):
            self.rows.append((stamp_ns, now_ns))


def add_bodies(
    scene: vtkMRMLScene, frames: Sequence[str], parents: Sequence[vtkMRMLTransformNode]
) -> None:
    surface = smooth_surface(lobed_tumor(_TRIANGLES))
    for frame, parent in zip(frames, parents, strict=True):
        add_model(scene, f"{frame}_model", surface, (0.7, 0.7, 0.7), parent=parent)


class PlainListener(Receiver):
    """rclpy alone, without a scene: from the stamp to the callback, with Python's own messages."""

    def __init__(self) -> None:
        super().__init__()
        rclpy.init()
        self._node = rclpy.create_node("latency_listener")
        self._node.create_subscription(TFMessage, "/tf", self._take, 100)

    def run(self, has_ended: Callable[[], bool]) -> None:
        while not has_ended():
            rclpy.spin_once(self._node, timeout_sec=_PAUSE_S)

    def close(self) -> None:
        self._node.destroy_node()
        rclpy.shutdown()

    def _take(self, message: TFMessage) -> None:
        stamp = message.transforms[0].header.stamp
        self.add_row(stamp.sec * NS_PER_S + stamp.nanosec, time.time_ns())


class PolledIgtl(Receiver):
    """pyigtl's client, polled at 200 Hz like Slicer's OpenIGTLink connector."""

    # No arrivals: the client keeps only the last message of a device and does not count.

    def __init__(self, bodies: int, port: int) -> None:
        super().__init__()
        scene, frames = vtkMRMLScene(), body_frames(bodies)
        self.poses = PoseNodes(scene, ROOT, frames)
        add_bodies(scene, frames, list(self.poses.nodes.values()))
        self._indices = {frame: index for index, frame in enumerate(frames)}
        self._matrices: FloatArray = np.tile(np.eye(4), (len(frames), 1, 1))
        self._stamps_ns = [0] * len(frames)
        self._client = OpenIGTLinkClient("127.0.0.1", port)

    def run(self, has_ended: Callable[[], bool]) -> None:
        due_ns = time.monotonic_ns()
        while not has_ended():
            due_ns = max(due_ns + _POLL_NS, time.monotonic_ns())  # missed ticks are skipped
            time.sleep(max(0, due_ns - time.monotonic_ns()) / NS_PER_S)
            for message in self._client.get_latest_messages():
                index = self._indices[message.device_name]
                self._matrices[index] = message.matrix
                self._stamps_ns[index] = round(message.timestamp * NS_PER_S)
            self.poses.move(self._matrices)
            self.add_row(complete_frame_stamp(self._stamps_ns) or None, time.time_ns())

    def close(self) -> None:
        self._client.stop()


def complete_frame_stamp(stamps_ns: Sequence[int]) -> int | None:
    """The first body's stamp; None if another body still belongs to an earlier frame."""
    return stamps_ns[0] if min(stamps_ns) >= stamps_ns[0] else None
