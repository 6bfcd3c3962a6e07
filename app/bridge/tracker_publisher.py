"""Publish samples of a tracker, an OpenIGTLink server or a simulated operation on ROS topics."""

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from threading import Event
from typing import Protocol

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from marginguard_msgs.msg import TrackedTransform as TrackedTransformMessage
from numpy.typing import NDArray
from sensor_msgs.msg import Image, JointState
from tf2_msgs.msg import TFMessage

from app.bridge import topics
from app.bridge.convert.array_messages import image_message
from app.bridge.messages import (
    diagnostic_status,
    header_message,
    joint_state_message,
    transform_message,
)
from app.bridge.node import RosNode
from app.bridge.topics import NEWEST, STREAM, Topic
from app.case import JointSample
from app.geometry import ImageSample, InputError, Stamp, TrackedTransform, Transform
from app.igtl import DeviceImages, Header
from app.igtl.source import IgtlSource
from app.runtime import ImageIntake

TRACKED_TRANSFORMS = Topic("/tracked_transforms", TrackedTransformMessage, STREAM)
"""Every sample, including lost ones."""

_NAN = math.nan

_IMAGE_FRAME = "image"
_ENCODINGS = {("uint8", 2): "mono8", ("uint16", 2): "mono16", ("uint8", 3): "rgb8"}
"""Type of the values and number of dimensions: encoding."""

OPERATION_NODE = "marginguard_operation"


class TrackerPublisher:
    """Publishes samples on ``topic`` and valid ones also on ``/tf``.

    Stamps are not changed. Lost samples are not on ``/tf``, which has no field for a status.
    """

    def __init__(self, ros: RosNode, topic: Topic = TRACKED_TRANSFORMS) -> None:
        self._tracked = ros.publisher(topic)
        self._tf = ros.publisher(topics.TF)

    def publish(self, samples: Sequence[TrackedTransform]) -> None:
        """Publish ``samples``; the valid ones go into one ``/tf`` message."""
        valid = []
        for sample in samples:
            message = tracked_message(sample)
            self._tracked.publish(message)
            if sample.transform is not None:
                valid.append(
                    TransformStamped(
                        header=message.header,
                        child_frame_id=message.child_frame_id,
                        transform=message.transform,
                    )
                )
        if valid:
            self._tf.publish(TFMessage(transforms=valid))


def tracked_message(sample: TrackedTransform) -> TrackedTransformMessage:
    """Convert ``sample`` to a message in metres; all numbers are NaN if it is lost."""
    message = TrackedTransformMessage(
        header=header_message(sample.target, sample.stamp),
        child_frame_id=sample.source,
        status=int(sample.status),
    )
    if sample.transform is None:
        message.transform.translation = Vector3(x=_NAN, y=_NAN, z=_NAN)
        message.transform.rotation = Quaternion(x=_NAN, y=_NAN, z=_NAN, w=_NAN)
    else:
        message.transform = transform_message(sample.transform, sample.stamp).transform
    return message


class IgtlPublisher(TrackerPublisher):
    """Publishes samples, and the connection to their server on ``/diagnostics``."""

    def __init__(self, ros: RosNode) -> None:
        super().__init__(ros)
        self._ros = ros
        self._diagnostics = ros.publisher(topics.DIAGNOSTICS)

    def report(self, source: IgtlSource, superseded: int) -> None:
        """Publish the state of the connection and its counters on ``/diagnostics``."""
        now = self._ros.node.get_clock().now().to_msg()
        array = DiagnosticArray(status=[_diagnostic(source, superseded)])
        array.header.stamp = now
        self._diagnostics.publish(array)


def _diagnostic(source: IgtlSource, superseded: int) -> DiagnosticStatus:
    counts = source.counts()
    refused = any(": refused" in key for key in counts)
    level = DiagnosticStatus.WARN if refused else DiagnosticStatus.OK
    values = {
        **{key: str(count) for key, count in sorted(counts.items())},
        "samples that a newer one replaced": str(superseded),
        "last refusal": source.last_refusal,
    }
    level = level if source.connected else DiagnosticStatus.ERROR
    return diagnostic_status("OpenIGTLink", level, source.status, values)


def message_of_image(image: ImageSample) -> Image:
    """``image`` with its own stamp; raises `InputError` for one that a message cannot hold."""
    if image.pixels is None or image.stamp is None:
        raise InputError("image has no pixels or no stamp; expected both")
    kind = image.pixels.dtype.name, image.pixels.ndim
    if kind not in _ENCODINGS:
        raise InputError(f"image has pixels of {kind[0]}; expected uint8, uint16 or RGB of uint8")
    pixels = np.ascontiguousarray(image.pixels)
    return image_message(pixels, _ENCODINGS[kind], _IMAGE_FRAME, image.stamp)


class IgtlImagePublisher:
    """Publishes IMAGE messages of one device on ``topic``, each with its own stamp.

    Give `receive` to the source. Images are read and published in a thread of their own, the newest
    only. ``device`` None: that of the first image. ``report`` takes why an image is refused, once
    until the reason changes; `problem` is that of the last image. ``check`` raises `InputError` for
    an image that is not to be published.
    """

    def __init__(
        self,
        ros: RosNode,
        topic: str,
        device: str | None,
        report: Callable[[str], None],
        check: Callable[[ImageSample], None] = lambda image: None,
    ) -> None:
        self._publisher = ros.publisher(Topic(topic, Image, NEWEST))
        self._images, self._report = DeviceImages(device), report
        self.problem = ""
        self._check = check
        self._counts: Counter[str] = Counter()
        self._intake = ImageIntake(self, self._decode)

    def receive(self, header: Header, body: bytes) -> None:
        """Take a message as it came, without reading it."""
        self._intake.put((header, body))

    def add(self, image: ImageSample) -> None:
        """Publish ``image``."""
        try:
            self._check(image)
            message = message_of_image(image)
        except InputError as error:
            self.refuse(str(error))
            return
        self._counts["published"] += 1
        self.problem = ""
        self._publisher.publish(message)

    def refuse(self, problem: str) -> None:
        """Count an image that is not published, and report a new reason."""
        self._counts["refused"] += 1
        if problem != self.problem:
            self.problem = problem
            self._report(problem)

    def counts(self) -> Mapping[str, int]:
        """Numbers of published and refused images."""
        return dict(self._counts)

    def close(self) -> None:
        """Publish nothing more."""
        self._intake.close()

    def _decode(self, received: tuple[Header, bytes]) -> ImageSample | None:
        return self._images.read(*received)


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
            self._images.publish(image_message(moment.image, "mono8", _IMAGE_FRAME, now))
