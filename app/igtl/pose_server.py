"""Send tracked transforms to OpenIGTLink clients, as a PLUS server does."""

import socket
import struct
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import Self

import numpy as np

from app.geometry import TrackedTransform, TrackingStatus, join_transform_name
from app.igtl.errors import IgtlError
from app.igtl.wire import pack_message, pack_message_with_metadata

HOST = "127.0.0.1"
MAX_CLIENTS = 8
MAX_NAME_BYTES = 20
"""Maximum length of a device name in the protocol; PLUS truncates longer ones."""

_MATRIX = struct.Struct(">12f")
_RECEIVE_BYTES = 1 << 12


def transform_message(sample: TrackedTransform, version: int) -> bytes | None:
    """``sample`` as TRANSFORM of header version 1 or 2.

    Version 2 has the metadata ``TransformStatus``; a lost sample is the identity then. Version 1
    has no status, so it has no message for a lost sample: None.
    """
    name = join_transform_name(sample.source, sample.target)
    matrix = np.eye(4) if sample.transform is None else sample.transform.matrix
    content = _MATRIX.pack(*matrix[:3, :3].T.ravel(), *matrix[:3, 3])
    if version == 1:
        if sample.transform is None:
            return None
        return pack_message("TRANSFORM", name, sample.stamp.ns, content)
    status = TrackingStatus(sample.status).name
    return pack_message_with_metadata(
        "TRANSFORM", name, sample.stamp.ns, content, {"TransformStatus": status}
    )


class _Client:
    """A connection; ``version`` is the highest header version that the client has used."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self.connection, self.version = connection, 1

    def is_open(self) -> bool:
        """Read and discard what the client sends."""
        try:
            while data := self.connection.recv(_RECEIVE_BYTES):
                if len(data) >= 2 and data[:2] == b"\0\2":
                    self.version = 2
        except BlockingIOError:
            return True
        except OSError:
            return False
        return False


class PoseServer:
    """``with PoseServer(18944) as server: server.send(samples)``; for clients of this machine.

    `send` does not wait: a client that has not read for so long that its buffer is full is
    disconnected. Raises `IgtlError` for a port that cannot be used.
    """

    def __init__(self, port: int) -> None:
        try:
            self._listener = socket.create_server((HOST, port))
        except (OSError, OverflowError) as error:
            raise IgtlError(f"OpenIGTLink port {port}: {error}; expected a free port") from error
        self.port = int(self._listener.getsockname()[1])
        self._lock = threading.Lock()
        self._clients: list[_Client] = []
        self._thread = threading.Thread(target=self._accept, name="OpenIGTLink", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def clients(self) -> int:
        """Number of clients that are connected."""
        with self._lock:
            return len(self._clients)

    def send(self, samples: Sequence[TrackedTransform]) -> None:
        """Send ``samples`` to all clients."""
        with self._lock:
            clients = list(self._clients)
        for client in clients:
            if not client.is_open() or not self._sent(client, samples):
                self._remove(client)

    def close(self) -> None:
        """Disconnect all clients and free the port."""
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join()
        with self._lock:
            clients, self._clients = self._clients, []
        for client in clients:
            client.connection.close()

    def _sent(self, client: _Client, samples: Sequence[TrackedTransform]) -> bool:
        messages = (transform_message(each, client.version) for each in samples)
        data = b"".join(message for message in messages if message is not None)
        try:
            return client.connection.send(data) == len(data)
        except OSError:
            return False

    def _remove(self, client: _Client) -> None:
        client.connection.close()
        with self._lock:
            if client in self._clients:
                self._clients.remove(client)

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            with self._lock:
                if len(self._clients) < MAX_CLIENTS:
                    self._clients.append(_Client(connection))
                    continue
            connection.close()
