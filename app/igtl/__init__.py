"""OpenIGTLink client: tracked transforms with their status from a PLUS server.

`wire`, `stream`, `poses` and `queue` do no input or output; `IgtlSource` owns a socket and a
thread.
"""

from app.igtl.errors import IgtlError
from app.igtl.image_link import receive_images, send_images
from app.igtl.images import MAX_IMAGE_BODY_BYTES, ImageReader, ReceivedImage, image_message
from app.igtl.queue import SampleQueue
from app.igtl.source import PORT, IgtlSource

__all__ = [
    "MAX_IMAGE_BODY_BYTES",
    "PORT",
    "IgtlError",
    "IgtlSource",
    "ImageReader",
    "ReceivedImage",
    "SampleQueue",
    "image_message",
    "receive_images",
    "send_images",
]
