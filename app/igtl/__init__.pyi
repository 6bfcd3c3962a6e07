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
from .source import IgtlSource, SampleQueue
from .tracked_poses import PoseServer
from .wire import Header, IgtlError, Unread, read_string

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
