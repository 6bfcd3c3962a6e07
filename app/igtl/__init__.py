"""OpenIGTLink: tracked transforms with their status from a PLUS server, or sent as by one.

`wire`, `stream`, `poses` and `queue` do no input or output; `IgtlSource` and `PoseServer` own
sockets and a thread.
"""

from app.igtl.errors import IgtlError
from app.igtl.image_link import receive_images, send_images
from app.igtl.images import (
    MAX_IMAGE_BODY_BYTES,
    DeviceImages,
    ImageReader,
    ReceivedImage,
    image_message,
    read_image,
)
from app.igtl.pose_server import PoseServer
from app.igtl.queue import SampleQueue
from app.igtl.source import PORT, IgtlSource
from app.igtl.stream import Unread
from app.igtl.strings import pack_string, read_string
from app.igtl.wire import Header

__all__ = [
    "MAX_IMAGE_BODY_BYTES",
    "PORT",
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
    "pack_string",
    "read_image",
    "read_string",
    "receive_images",
    "send_images",
]
