from .framing import Header, IgtlError, Unread, read_string
from .image_messages import (
    MAX_IMAGE_BODY_BYTES,
    DeviceImages,
    ImageReader,
    ReceivedImage,
    image_message,
    read_image,
    receive_images,
    send_images,
)
from .pose_messages import PoseServer
from .source import IgtlSource, SampleQueue

__all__ = [
    "MAX_IMAGE_BODY_BYTES",
    "DeviceImages",
    "Header",
    "IgtlError",
    "IgtlSource",
    "ImageReader",
    "PoseServer",
    "ReceivedImage",
    "SampleQueue",
    "Unread",
    "image_message",
    "read_image",
    "read_string",
    "receive_images",
    "send_images",
]
