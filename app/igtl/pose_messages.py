"""Tracked transforms with their status: read from TRANSFORM and TDATA messages, and served.

========= =================== ===================================== =======================
message   transform name      status (metadata, header version 2)   time
========= =================== ===================================== =======================
TRANSFORM device name         ``TransformStatus``; older servers    header
                              send only ``TransformValid``
TDATA     one per element     ``<name>Status``                      header, for all
========= =================== ===================================== =======================

``ToolToTracker`` is the frame ``tool`` in ``tracker``. Numbers are mm along the server's axes
and are not converted. A name has 20 bytes at most. PLUS truncates longer names, which then refer
to a frame that does not exist (``...ToReferenc``).
`framing` says why the messages of pyigtl are not used.
"""

import math
import socket
import struct
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Self

import numpy as np

from app.geometry import (
    FrameError,
    MarginGuardError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    TransformError,
    join_transform_name,
    split_transform_name,
)
from app.igtl.framing import (
    IgtlContentError,
    IgtlError,
    IgtlLimitError,
    Message,
    Refusals,
    pack_message,
)

TYPES = ("TRANSFORM", "TDATA")
MAX_EDGES = 256
"""Limit on the number of different transforms, which bounds the memory."""

_MATRIX = struct.Struct(">12f")
_ELEMENT = struct.Struct(">20sBx12f")
_FULL_POSES = (1, 2)
"""TDATA element types tracker and 6D. Others (3D, 5D) have no complete measured orientation."""

_OTHER_WORDS = {"REQ_TIMEOUT": TrackingStatus.REQUEST_TIMEOUT}

HOST = "127.0.0.1"
MAX_CLIENTS = 8
MAX_NAME_BYTES = 20
"""Maximum length of a device name in the protocol; PLUS truncates longer ones."""

_RECEIVE_BYTES = 1 << 12


class PoseReader:
    """Reads messages; adds invalid messages and TDATA elements to ``refusals``.

    ``without_status`` counts samples without a status (header version 1 has no field for it). They
    are treated as valid, like those of a recording without statuses.
    """

    def __init__(self, refusals: Refusals) -> None:
        self.without_status = 0
        self._refusals = refusals
        self._edges: set[tuple[str, str]] = set()

    def read(self, message: Message) -> list[TrackedTransform]:
        """Samples of a message of one of `TYPES`, in its order."""
        samples = []
        try:
            stamp = message.stamp
            for name, numbers, status in _poses(message):
                try:
                    samples.append(self._sample(name, numbers, stamp, status))
                except MarginGuardError as error:
                    self._refusals.add(error)
        except MarginGuardError as error:
            self._refusals.add(error)
        return samples

    def _sample(
        self, name: str, numbers: tuple[float, ...], stamp: Stamp, status: TrackingStatus | None
    ) -> TrackedTransform:
        frames = split_transform_name(name)
        if frames is None:
            raise FrameError(f"transform name is {name!r}; expected the form AToB")
        if frames not in self._edges:
            if len(self._edges) >= MAX_EDGES:
                raise IgtlLimitError(
                    f"transform {name!r} is one too many; expected at most {MAX_EDGES}"
                )
            self._edges.add(frames)
        if status is None:
            self.without_status += 1
        return _tracked(frames, numbers, stamp, status or TrackingStatus.OK)


def _poses(
    message: Message,
) -> Iterator[tuple[str, tuple[float, ...], TrackingStatus | None]]:
    """Name, columns of the matrix (rotation, then translation) and status, None if missing."""
    if message.type == "TRANSFORM":
        if len(message.content) != _MATRIX.size:
            raise IgtlContentError(
                f"TRANSFORM {message.device!r} has {len(message.content)} bytes; "
                f"expected {_MATRIX.size}"
            )
        yield message.device, _MATRIX.unpack(message.content), _status(message.metadata)
        return
    if len(message.content) % _ELEMENT.size:
        raise IgtlContentError(
            f"TDATA {message.device!r} has {len(message.content)} bytes; "
            f"expected elements of {_ELEMENT.size} bytes"
        )
    for raw_name, kind, *numbers in _ELEMENT.iter_unpack(message.content):
        # A name that is not ASCII is refused later; the error then shows its bytes.
        name = raw_name.rstrip(b"\0").decode("ascii", "backslashreplace")
        status = _status_of_word(message.metadata.get(f"{name}Status"))
        if kind not in _FULL_POSES and status in (None, TrackingStatus.OK):
            status = TrackingStatus.INVALID
        yield name, tuple(numbers), status


def _status(metadata: Mapping[str, str]) -> TrackingStatus | None:
    status = _status_of_word(metadata.get("TransformStatus"))
    valid = metadata.get("TransformValid", "").strip().lower()
    if status in (None, TrackingStatus.OK) and valid not in ("", "1", "true"):
        return TrackingStatus.INVALID
    return status


def _status_of_word(word: str | None) -> TrackingStatus | None:
    if word is None:
        return None
    name = word.strip().upper().removeprefix("TOOL_")
    # An unknown status is not OK.
    known = _OTHER_WORDS.get(name) or TrackingStatus.__members__.get(name, TrackingStatus.INVALID)
    return TrackingStatus(known)


def _tracked(
    frames: tuple[str, str], numbers: tuple[float, ...], stamp: Stamp, status: TrackingStatus
) -> TrackedTransform:
    source, target = frames
    if status is TrackingStatus.OK and not all(map(math.isfinite, numbers)):
        status = TrackingStatus.NOT_FINITE
    if status is TrackingStatus.OK:
        columns = np.array(numbers).reshape(4, 3)
        try:
            transform = Transform(target, source, columns[:3].T, columns[3])
            return TrackedTransform(transform, stamp, status)
        except TransformError:
            status = TrackingStatus.NOT_RIGID
    return TrackedTransform.lost(target, source, stamp, status)


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
    return pack_message("TRANSFORM", name, sample.stamp.ns, content, {"TransformStatus": status})


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
