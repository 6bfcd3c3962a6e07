"""OpenIGTLink in: tracked transforms with their status from a PLUS server.

`wire`, `stream`, `poses` and `queue` are pure, `IgtlSource` is a socket and a thread, and
`IgtlPublisher` alone knows ROS.
"""

from app.bridge.igtl.errors import IgtlError
from app.bridge.igtl.publisher import IgtlPublisher
from app.bridge.igtl.queue import SampleQueue
from app.bridge.igtl.source import PORT, IgtlSource

__all__ = ["PORT", "IgtlError", "IgtlPublisher", "IgtlSource", "SampleQueue"]
