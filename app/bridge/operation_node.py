"""Publishes a simulated operation on the ROS graph, as tracker, probe and robot would."""

import time
from collections.abc import Callable, Mapping, Sequence
from threading import Event
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image, JointState

from app.bridge.convert.images import image_message
from app.bridge.messages import joint_state_message
from app.bridge.node import RosNode
from app.bridge.qos import STREAM, Topic
from app.bridge.tracker_publisher import TRACKED_TRANSFORMS, tracked_message
from app.case import JointSample
from app.geometry import Stamp, TrackedTransform, Transform

NODE_NAME = "marginguard_operation"


class Moment(Protocol):
    """Poses in the tracker's frame, joints by name in rad, and an image (rows, columns) or None."""

    @property
    def poses(self) -> Sequence[Transform]:
        """Measured poses."""

    @property
    def joints(self) -> Mapping[str, float]:
        """Positions of the arm's joints."""

    @property
    def image(self) -> NDArray[np.uint8] | None:
        """Pixels, None between two images."""


class OperationNode:
    """Sends the moments of ``step``, ``rate_hz`` of them a second, with stamps of now."""

    def __init__(
        self, ros: RosNode, step: Callable[[], Moment], rate_hz: float, image_topic: str
    ) -> None:
        self._step, self._period_s = step, 1.0 / rate_hz
        self._poses = ros.publisher(TRACKED_TRANSFORMS)
        self._joints = ros.publisher(Topic("/joint_states", JointState, STREAM))
        self._images = ros.publisher(Topic(image_topic, Image, STREAM))

    def run(self, stop: Event, requests: Callable[[], None]) -> None:
        """Send until ``stop`` is set; ``requests`` is called before each moment.

        A moment that is late is sent at once, and the next one a period after it.
        """
        due_s = time.monotonic()
        while not stop.wait(max(0.0, due_s - time.monotonic())):
            due_s = max(due_s + self._period_s, time.monotonic())
            requests()
            self._send(self._step(), Stamp(time.time_ns()))

    def _send(self, moment: Moment, now: Stamp) -> None:
        for pose in moment.poses:
            self._poses.publish(tracked_message(TrackedTransform.valid(pose, now)))
        names = tuple(moment.joints)
        positions = tuple(moment.joints[name] for name in names)
        self._joints.publish(joint_state_message(JointSample(names, positions, now)))
        if moment.image is not None:
            self._images.publish(image_message(moment.image, "mono8", "image", now))
