"""Images over a TCP connection: received from an OpenIGTLink server, or sent to one client."""

import socket
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress

from app.geometry import NS_PER_S
from app.igtl.errors import IgtlError
from app.igtl.images import MAX_IMAGE_BODY_BYTES, TYPES, ImageReader, ReceivedImage
from app.igtl.stream import MessageStream, Refusals
from app.igtl.wire import start_tracking_request

_CONNECT_TIMEOUT_S = 3.0
_CHUNK_BYTES = 1 << 16


def receive_images(
    host: str, port: int, refusals: Refusals, *, silence_s: float = 5.0
) -> Iterator[ReceivedImage]:
    """Yield the images that the server at ``host`` sends, until it closes the connection.

    Invalid messages are added to ``refusals``. Raises `IgtlError` where there is no server, and
    after ``silence_s`` without a byte.
    """
    stream, reader = MessageStream(TYPES, refusals, MAX_IMAGE_BODY_BYTES), ImageReader(refusals)
    try:
        with socket.create_connection((host, port), _CONNECT_TIMEOUT_S) as server:
            server.sendall(start_tracking_request())
            server.settimeout(silence_s)
            while data := server.recv(_CHUNK_BYTES):
                for message in stream.feed(data):
                    found = reader.read(message)
                    if found is not None:
                        yield found
    except TimeoutError as error:
        raise IgtlError(
            f"OpenIGTLink server {host}:{port}: nothing for {silence_s:g} s; expected images"
        ) from error
    except (OSError, UnicodeError) as error:
        raise IgtlError(f"OpenIGTLink server {host}:{port}: {error}; expected a server") from error


def send_images(
    listener: socket.socket,
    packets: Iterable[tuple[int, bytes]],
    *,
    sleep_s: Callable[[float], None] = time.sleep,
) -> int:
    """Wait for one client of ``listener``, and send it ``packets`` in the pace of their times.

    ``packets``: time in ns and an encoded message, in the order of the times. Returns how many were
    sent; a client that disconnects ends it.
    """
    client, _ = listener.accept()
    sent, last_ns = 0, None
    with client:
        for stamp_ns, packet in packets:
            if last_ns is not None:
                sleep_s(max(0, stamp_ns - last_ns) / NS_PER_S)
            last_ns = stamp_ns
            try:
                client.sendall(packet)
            except OSError:
                return sent
            sent += 1
        _finish(client)
    return sent


def _finish(client: socket.socket) -> None:
    """Wait until ``client`` has closed: closing with its requests unread would discard images."""
    with suppress(OSError):
        client.shutdown(socket.SHUT_WR)
        client.settimeout(_CONNECT_TIMEOUT_S)
        while client.recv(_CHUNK_BYTES):
            pass
