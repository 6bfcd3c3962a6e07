"""IMAGE messages: one ultrasound image with its place, to and from the wire.

The body is a header of 72 bytes and the pixels, column after column of the first row, then the next
row. The header has the directions of columns, rows and slices, each as long as the pixel, and the
place of the middle of the image. `framing` says why the messages of pyigtl are not used.
"""

import socket
import struct
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from app.geometry import (
    MAX_IMAGE_SIDE,
    NS_PER_S,
    FloatArray,
    ImageSample,
    ImageStatus,
    MarginGuardError,
)
from app.igtl.framing import (
    Header,
    IgtlContentError,
    IgtlError,
    IgtlStampError,
    Message,
    MessageStream,
    Refusals,
    pack_message,
    read_message,
    start_tracking_request,
)

TYPES = ("IMAGE",)
MAX_IMAGE_BODY_BYTES = 1 << 25
"""32 MiB: 8192 x 4096 pixels of one byte."""

_HEAD = struct.Struct(">HBBBB3H12f6H")
_LITTLE, _BIG = 2, 1
_RAS, _LPS = 1, 2
_TYPES = {2: "i1", 3: "u1", 4: "i2", 5: "u2"}
_CODES = {np.dtype(name): code for code, name in _TYPES.items()}

_CONNECT_TIMEOUT_S = 3.0
_SILENCE_S = 5.0
_CHUNK_BYTES = 1 << 16


@dataclass(frozen=True, slots=True, eq=False)
class ReceivedImage:
    """An image of ``device``. ``matrix`` (4, 4): (column, row, 0) to mm in RAS axes of its frame.

    OpenIGTLink does not name the orientation of the pixels. PLUS sends MF.
    """

    device: str
    image: ImageSample
    matrix: FloatArray


class ImageReader:
    """Reads IMAGE messages; adds invalid ones to ``refusals``.

    The first image of a device determines size, channels and type: others are refused.
    """

    def __init__(self, refusals: Refusals) -> None:
        self._refusals = refusals
        self._kinds: dict[str, tuple[tuple[int, ...], str]] = {}
        self._count = 0

    def read(self, message: Message) -> ReceivedImage | None:
        """The image of ``message``; None for one that is refused."""
        try:
            found = _decoded(message, self._count)
            pixels = found.image.pixels
            if pixels is None:
                raise IgtlContentError(f"IMAGE {message.device!r} has no pixels; expected some")
            kind = pixels.shape, pixels.dtype.name
            known = self._kinds.setdefault(message.device, kind)
            if kind != known:
                raise IgtlContentError(
                    f"IMAGE {message.device!r} has pixels {kind[0]} of {kind[1]}; expected "
                    f"{known[0]} of {known[1]}, as its first image"
                )
        except MarginGuardError as error:
            self._refusals.add(error)
            return None
        self._count += 1
        return found


def read_image(header: Header, body: bytes) -> ReceivedImage:
    """Read an IMAGE message as it came; raises `IgtlError` or `InputError` if it is invalid."""
    return _decoded(read_message(header, body), 0)


def image_message(device: str, image: ImageSample, matrix: FloatArray) -> bytes:
    """Encode ``image`` in header version 1; ``matrix`` (4, 4): (column, row, 0) to mm in RAS axes.

    Raises `IgtlContentError` for an image without pixels and `IgtlStampError` without a time.
    """
    pixels = image.pixels
    if pixels is None:
        raise IgtlContentError(f"image {image.number} has no pixels; expected some")
    if image.stamp is None:
        raise IgtlStampError(f"image {image.number} has no time; expected one")
    rows, columns = pixels.shape[:2]
    center = matrix @ np.array([(columns - 1) / 2.0, (rows - 1) / 2.0, 0.0, 1.0])
    head = _HEAD.pack(
        1, 3 if pixels.ndim == 3 else 1, _CODES[pixels.dtype], _LITTLE, _RAS, columns, rows, 1,
        *matrix[:3, 0], *matrix[:3, 1], *matrix[:3, 2], *center[:3],
        0, 0, 0, columns, rows, 1,
    )  # fmt: skip
    content = pixels.astype(pixels.dtype.newbyteorder("<"), copy=False).tobytes()
    return pack_message("IMAGE", device, image.stamp.ns, head + content)


def _decoded(message: Message, number: int) -> ReceivedImage:
    name, stamp = f"IMAGE {message.device!r}", message.stamp
    if len(message.content) < _HEAD.size:
        raise IgtlContentError(
            f"{name} has {len(message.content)} bytes; expected {_HEAD.size} or more"
        )
    _, channels, code, order, axes, *others = _HEAD.unpack_from(message.content)
    (columns, rows, slices), numbers, part = others[:3], others[3:15], others[15:]
    if code not in _TYPES or order not in (_LITTLE, _BIG) or axes not in (_RAS, _LPS):
        raise IgtlContentError(
            f"{name} has pixel type {code}, byte order {order} and axes {axes}; expected types "
            f"{', '.join(map(str, _TYPES))}, and 1 or 2"
        )
    if channels not in (1, 3) or slices != 1 or min(columns, rows) < 1:
        raise IgtlContentError(
            f"{name} is {columns} x {rows} x {slices} of {channels} values; expected one slice of "
            "1 or 3 values"
        )
    if max(columns, rows) > MAX_IMAGE_SIDE or part != [0, 0, 0, columns, rows, 1]:
        raise IgtlContentError(
            f"{name} is the part {part} of {columns} x {rows}; expected a whole image of up to "
            f"{MAX_IMAGE_SIDE} on each side"
        )
    dtype = np.dtype(_TYPES[code]).newbyteorder("<" if order == _LITTLE else ">")
    expected = columns * rows * channels * dtype.itemsize
    content = message.content[_HEAD.size :]
    if len(content) != expected:
        raise IgtlContentError(f"{name} has {len(content)} bytes of pixels; expected {expected}")
    shape = (rows, columns, 3) if channels == 3 else (rows, columns)
    pixels = np.frombuffer(content, dtype).reshape(shape)
    pixels = pixels.astype(pixels.dtype.newbyteorder("="), copy=False)
    image = ImageSample(number, stamp, ImageStatus.OK, pixels)
    return ReceivedImage(message.device, image, _matrix(numbers, columns, rows, axes, name))


def _matrix(numbers: list[float], columns: int, rows: int, axes: int, name: str) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3] = np.array(numbers, dtype=np.float64).reshape(4, 3).T
    if not np.isfinite(matrix).all():
        raise IgtlContentError(f"{name} has a matrix that is not finite: {numbers}")
    matrix[:3, 3] -= matrix[:3, :2] @ ((columns - 1) / 2.0, (rows - 1) / 2.0)
    if axes == _LPS:
        matrix[:2] *= -1.0
    return matrix


class DeviceImages:
    """Reads the IMAGE messages of one device; ``device`` None: that of the first image read."""

    def __init__(self, device: str | None) -> None:
        self._device = device

    def read(self, header: Header, body: bytes) -> ImageSample | None:
        """The image, with the size of its pixels; None for one of another device.

        Raises as `read_image`.
        """
        name = header.device.decode("ascii", "replace")
        if self._device is not None and name != self._device:
            return None
        found = read_image(header, body)
        self._device = name
        width, height = np.linalg.norm(found.matrix[:3, :2], axis=0)
        return replace(found.image, pixel_mm=(float(width), float(height)))


def receive_images(host: str, port: int, refusals: Refusals) -> Iterator[ReceivedImage]:
    """Yield the images that the server at ``host`` sends, until it closes the connection.

    Invalid messages are added to ``refusals``. Raises `IgtlError` where there is no server, and
    after 5 s without a byte.
    """
    stream, reader = MessageStream(TYPES, refusals, MAX_IMAGE_BODY_BYTES), ImageReader(refusals)
    try:
        with socket.create_connection((host, port), _CONNECT_TIMEOUT_S) as server:
            server.sendall(start_tracking_request())
            server.settimeout(_SILENCE_S)
            while data := server.recv(_CHUNK_BYTES):
                for message in stream.feed(data):
                    found = reader.read(message)
                    if found is not None:
                        yield found
    except TimeoutError as error:
        raise IgtlError(
            f"OpenIGTLink server {host}:{port}: nothing for {_SILENCE_S:g} s; expected images"
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
