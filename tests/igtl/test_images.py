"""IMAGE messages against pyigtl, in both directions, and invalid ones."""

import struct

import numpy as np
import pyigtl
import pytest
from pyigtl.messages import MessageBase

from app.geometry import ImageSample, ImageStatus, Stamp
from app.igtl import MAX_IMAGE_BODY_BYTES, ImageReader, ReceivedImage, image_message
from app.igtl.framing import (
    IgtlContentError,
    IgtlStampError,
    MessageStream,
    Refusals,
    pack_message,
    read_header,
)
from app.igtl.image_messages import TYPES

MATRIX = np.array([[0.1, 0.02, 0, 5], [0, 0.09, 0.3, -7], [0.01, 0, 0.2, 11], [0, 0, 0, 1.0]])
SHAPES = {"uint8": (6, 9), "int16": (5, 4), "uint16": (3, 3), "rgb": (4, 7, 3)}


def pixels(kind: str) -> np.ndarray:
    dtype = np.dtype("uint8" if kind == "rgb" else kind)
    limits = np.iinfo(dtype)
    rng = np.random.default_rng(4)
    return rng.integers(limits.min, limits.max, SHAPES[kind], dtype, endpoint=True)


def peer(values: np.ndarray, axes: str = "ras", time_s: float = 12.5) -> bytes:
    """The image as pyigtl encodes it."""
    return pyigtl.ImageMessage(
        values[None], MATRIX, axes, timestamp=time_s, device_name="Image_Reference"
    ).pack()


def received(*packets: bytes) -> tuple[list[ReceivedImage], Refusals]:
    refusals = Refusals()
    stream, reader = MessageStream(TYPES, refusals, MAX_IMAGE_BODY_BYTES), ImageReader(refusals)
    found = [reader.read(each) for packet in packets for each in stream.feed(packet)]
    return [image for image in found if image is not None], refusals


@pytest.mark.parametrize("axes", ["ras", "lps"])
@pytest.mark.parametrize("kind", SHAPES)
def test_image_of_pyigtl_is_read(kind, axes):
    values = pixels(kind)
    (found,), refusals = received(peer(values, axes))
    assert not refusals.counts
    assert (found.device, found.image.stamp) == ("Image_Reference", Stamp(12_500_000_000))
    assert found.image.pixels is not None and found.image.pixels.dtype == values.dtype
    np.testing.assert_array_equal(found.image.pixels, values)
    expected = MATRIX if axes == "ras" else np.diag([-1.0, -1, 1, 1]) @ MATRIX
    np.testing.assert_allclose(found.matrix, expected, rtol=0, atol=1e-5)  # 32-bit numbers


@pytest.mark.parametrize("kind", SHAPES)
def test_pyigtl_reads_our_image(kind):
    values = pixels(kind)
    sample = ImageSample(3, Stamp(12_500_000_000), ImageStatus.OK, values)
    packed = image_message("Image_Reference", sample, MATRIX)
    found = pyigtl.ImageMessage()
    fields = MessageBase.parse_header(packed[:58])
    assert (fields["message_type"], fields["device_name"]) == ("IMAGE", "Image_Reference")
    assert fields["timestamp"] == 12.5
    found.unpack(fields, packed[58:])
    np.testing.assert_array_equal(found.image[0], values)
    np.testing.assert_allclose(found.ijk_to_world_matrix, MATRIX, rtol=0, atol=1e-5)
    assert found.world_coordinate_system == "ras"


def test_image_of_another_size_is_refused_and_the_next_one_read():
    first, other = pixels("uint8"), pixels("uint8")[:-1]
    found, refusals = received(peer(first), peer(other), peer(first))
    assert [image.image.number for image in found] == [0, 1]
    assert refusals.counts == {"IgtlContentError": 1}
    assert refusals.last == (
        "IMAGE 'Image_Reference' has pixels (5, 9) of uint8; expected (6, 9) of uint8, as its "
        "first image"
    )


@pytest.mark.parametrize(
    ("place", "value", "expected"),
    [
        (2, b"\x02", "of 2 values; expected one slice of 1 or 3 values"),
        (3, b"\x0a", "pixel type 10"),
        (4, b"\x03", "byte order 3"),
        (5, b"\x00", "axes 0"),
        (6, b"\x00\x00", "is 0 x 6 x 1"),
        (10, b"\x00\x02", "9 x 6 x 2"),
        (8, b"\x00\x07", "is the part"),
        (12, struct.pack(">f", float("nan")), "not finite"),
    ],
)
def test_damaged_header_is_refused_in_one_line(place, value, expected):
    body = bytearray(peer(pixels("uint8"))[58:])
    body[place : place + len(value)] = value
    found, refusals = received(pack_message("IMAGE", "Image", 1_000_000_000, bytes(body)))
    assert (found, sum(refusals.counts.values())) == ([], 1)
    assert expected in refusals.last and "\n" not in refusals.last


@pytest.mark.parametrize("length", [0, 71, 72, 100, 72 + 53, 72 + 55])
def test_cut_image_is_refused(length):
    body = (peer(pixels("uint8"))[58:] + b"\0")[:length]
    found, refusals = received(pack_message("IMAGE", "Image", 1_000_000_000, body))
    assert (found, refusals.counts) == ([], {"IgtlContentError": 1})


def test_image_without_a_time_is_neither_read_nor_sent():
    body = peer(pixels("uint8"))[58:]
    _, refusals = received(pack_message("IMAGE", "Image", 0, body))
    assert refusals.counts == {"IgtlStampError": 1}
    with pytest.raises(IgtlStampError):
        image_message("Image", ImageSample(0, None, ImageStatus.OK, pixels("uint8")), MATRIX)
    with pytest.raises(IgtlContentError):
        image_message("Image", ImageSample(0, Stamp(1), ImageStatus.INVALID, None), MATRIX)


@pytest.mark.parametrize("device", ["", "a" * 21, "Größe"])
def test_device_name_that_does_not_fit_is_refused(device):
    with pytest.raises(IgtlContentError, match="expected 1 to 20 ASCII characters"):
        pack_message("IMAGE", device, 1, b"")


def test_stamp_is_exact_to_the_nanosecond():
    for ns in (1, 999_999_999, 1_700_000_000_123_456_789):
        assert read_header(pack_message("IMAGE", "a", ns, b"")[:58]).stamp_ns == ns


def test_images_are_skipped_by_a_stream_with_the_limit_of_poses():
    refusals = Refusals()
    stream = MessageStream(TYPES, refusals)
    assert stream.feed(peer(np.zeros((300, 300), np.uint8))) == []
    assert refusals.counts == {"IgtlLimitError": 1}
