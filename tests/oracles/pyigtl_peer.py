"""OpenIGTLink messages encoded by pyigtl, extended by TDATA, and a server of pyigtl.

As a process: ``pyigtl_peer.py PORT`` (0: any free port) prints ``port N``, then sends each message
that it reads from standard input as a line of JSON: type, name, time_s, version, metadata, and
``matrix`` for TRANSFORM or ``elements`` ([name, type, matrix], ...) for TDATA. It does not import
the project.
"""

import json
import sys

import numpy as np
import pyigtl
from pyigtl.messages import MessageBase

ELEMENT = np.dtype([("name", "S20"), ("type", "u1"), ("reserved", "u1"), ("columns", ">f4", 12)])


class TrackingDataMessage(MessageBase):
    """TDATA message: 70 bytes per element."""

    def __init__(self, elements, timestamp, device_name):
        super().__init__(timestamp=timestamp, device_name=device_name)
        self._message_type = "TDATA"
        self._valid_message = True
        self.elements = elements

    def _pack_content(self):
        rows = [(n.encode(), t, 0, np.array(m)[:3].T.ravel()) for n, t, m in self.elements]
        return np.array(rows, dtype=ELEMENT).tobytes()


def message(type="TRANSFORM", name="StylusToTracker", time_s=1.5, version=2, metadata=None, **body):
    """Create a pyigtl message; ``.pack()`` encodes it."""
    if type == "TRANSFORM":
        result = pyigtl.TransformMessage(body["matrix"], timestamp=time_s, device_name=name)
    elif type == "TDATA":
        result = TrackingDataMessage(body["elements"], time_s, name)
    else:
        result = pyigtl.StringMessage(body["string"], timestamp=time_s, device_name=name)
    result.header_version = version
    result.metadata = metadata or {}
    return result


def main() -> None:
    server = pyigtl.OpenIGTLinkServer(port=int(sys.argv[1]), local_server=True)
    print(f"port {server.server_address[1]}", flush=True)
    for line in sys.stdin:
        server.send_message(message(**json.loads(line)), wait=False)
    server.stop()


if __name__ == "__main__":
    main()
