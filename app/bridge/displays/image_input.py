"""Images of a live session, as a display receives them from their topic."""

from sensor_msgs.msg import Image

from app.bridge.node import RosNode
from app.bridge.qos import INCOMING_IMAGE, Topic
from app.case import read_image_message, standard_image
from app.geometry import ImageSample, InputError
from app.runtime import ImageIntake
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
