"""Publish the images of an OpenIGTLink server on a ROS topic."""

from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np
from sensor_msgs.msg import Image

from app.bridge.convert import image_message
from app.bridge.node import RosNode
from app.bridge.qos import NEWEST, Topic
from app.geometry import ImageSample, InputError
from app.igtl import DeviceImages, Header
from app.runtime import ImageIntake

_FRAME = "image"
_ENCODINGS = {("uint8", 2): "mono8", ("uint16", 2): "mono16", ("uint8", 3): "rgb8"}
"""Type of the values and number of dimensions: encoding."""


def message_of_image(image: ImageSample) -> Image:
    """``image`` with its own stamp; raises `InputError` for one that a message cannot hold."""
    if image.pixels is None or image.stamp is None:
        raise InputError("image has no pixels or no stamp; expected both")
    kind = image.pixels.dtype.name, image.pixels.ndim
    if kind not in _ENCODINGS:
        raise InputError(f"image has pixels of {kind[0]}; expected uint8, uint16 or RGB of uint8")
    pixels = np.ascontiguousarray(image.pixels)
    return image_message(pixels, _ENCODINGS[kind], _FRAME, image.stamp)


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
