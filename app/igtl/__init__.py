"""OpenIGTLink client: tracked transforms with their status from a PLUS server.

`wire`, `stream`, `poses` and `queue` do no input or output; `IgtlSource` owns a socket and a
thread.
"""

from app.igtl.errors import IgtlError
from app.igtl.queue import SampleQueue
from app.igtl.source import PORT, IgtlSource

__all__ = ["PORT", "IgtlError", "IgtlSource", "SampleQueue"]
