"""Images of a live session: from a topic, or from the OpenIGTLink connection of its poses."""

from collections.abc import Callable, Mapping, Sequence

from sensor_msgs.msg import Image

from app.bridge.node import RosNode
from app.bridge.qos import INCOMING_IMAGE, Topic
from app.case import LiveCase, read_image_message, standard_image
from app.geometry import ImageSample, InputError, TrackedTransform
from app.igtl import DeviceImages, Header
from app.runtime import Deliver, ImageIntake
from app.session import LiveImages


class TopicImages:
    """Passes the images on ``topic`` to ``images``, in a thread of their own.

    Images of two publishers are refused: they would alternate. They have ``orientation``.
    """

    def __init__(self, ros: RosNode, topic: str, orientation: str, images: LiveImages) -> None:
        self._ros, self._topic, self._orientation = ros, topic, orientation
        self._intake = ImageIntake(images, self._decode)
        self._subscription = ros.subscribe(
            Topic(topic, Image, INCOMING_IMAGE), self._receive, raw=True
        )

    def counts(self) -> Mapping[str, int]:
        """Counts of images, for diagnostics."""
        return self._intake.counts()

    def close(self) -> None:
        """Deliver nothing more."""
        self._intake.close()

    def _receive(self, data: bytes) -> None:
        # Not by the sender of the message: only the newest of several that have come is received.
        self._intake.put((data, self._ros.node.count_publishers(self._topic)))

    def _decode(self, received: tuple[bytes, int]) -> ImageSample:
        data, publishers = received
        if publishers > 1:
            raise InputError(f"{self._topic} has {publishers} publishers of images; expected 1")
        try:
            image = read_image_message(data, 0)
        except InputError as error:
            raise InputError(f"{self._topic}: {error}") from error
        return standard_image(image, self._orientation)


class IgtlImages:
    """Passes the IMAGE messages of one device to ``images``, in a thread of their own.

    ``device`` None: that of the first image. Give `receive` to the source of the poses.
    """

    def __init__(self, device: str | None, orientation: str, images: LiveImages) -> None:
        self._images, self._orientation = DeviceImages(device), orientation
        self._intake = ImageIntake(images, self._decode)

    def receive(self, header: Header, body: bytes) -> None:
        """Take a message as it came, without reading it."""
        self._intake.put((header, body))

    def counts(self) -> Mapping[str, int]:
        """Counts of images, for diagnostics."""
        return self._intake.counts()

    def close(self) -> None:
        """Deliver nothing more."""
        self._intake.close()

    def _decode(self, received: tuple[Header, bytes]) -> ImageSample | None:
        image = self._images.read(*received)
        return None if image is None else standard_image(image, self._orientation)


ImageInput = TopicImages | IgtlImages


def image_input(ros: RosNode, config: LiveCase, images: LiveImages | None) -> ImageInput | None:
    """The input of ``images`` by ``config``; None for a session that shows none.

    Problems are logged by the node of ``ros``, once until they change.
    """
    entry = config.case.manifest.images
    if entry is None or images is None:
        return None
    logger = ros.node.get_logger()
    images.report = lambda problem: logger.warning(
        f"no image is shown: {problem}", throttle_duration_sec=1.0
    )
    orientation = entry.orientation or "MF"
    if entry.topic is not None:
        return TopicImages(ros, entry.topic, orientation, images)
    return IgtlImages(config.image_device, orientation, images)


def with_images(deliver: Deliver, images: LiveImages, refuses: Callable[[], bool]) -> Deliver:
    """``deliver`` that also gives the poses to ``images``, unless ``refuses()``."""

    def deliver_both(samples: Sequence[TrackedTransform]) -> None:
        deliver(samples)
        if not refuses():
            images.add_poses(samples)

    return deliver_both
