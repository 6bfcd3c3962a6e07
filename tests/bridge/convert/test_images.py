"""Conversion of images, including the layout of the ROS specification and invalid sizes."""

import numpy as np
import pytest
from sensor_msgs.msg import Image

from app.bridge.convert import ConversionError, image_array, image_message
from app.bridge.convert.array_messages import ENCODINGS
from app.geometry import Stamp

pytestmark = pytest.mark.slow

NOW = Stamp(5)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_image_converted_there_and_back_is_equal(encoding):
    sample, samples = ENCODINGS[encoding]
    shape = (3, 5) if samples == 1 else (3, 5, samples)
    pixels = (np.arange(np.prod(shape)) % 100).astype(sample).reshape(shape)
    message = image_message(pixels, encoding, "camera", NOW)
    back = image_array(message)
    assert back.dtype == pixels.dtype
    assert np.array_equal(back, pixels)
    assert (message.height, message.width) == (3, 5)
    assert len(message.data) == message.step * 3


def test_padded_rows_and_big_endian_samples():
    rows = bytes([1, 0, 0, 2, 9, 9, 0, 3, 4, 0, 9, 9])
    image = Image(height=2, width=2, encoding="mono16", step=6, is_bigendian=1)
    image.data.frombytes(rows)
    assert image_array(image).tolist() == [[256, 2], [3, 1024]]
    image.is_bigendian = 0
    assert image_array(image).tolist() == [[1, 512], [768, 4]]


def test_image_is_not_copied():
    image = image_message(np.zeros((480, 640, 3), np.uint8), "rgb8", "camera", NOW)
    assert np.shares_memory(image_array(image), np.frombuffer(image.data, np.uint8))


@pytest.mark.parametrize(
    "change",
    [
        {"encoding": "yuv422"},
        {"height": 2**32 - 1},
        {"width": 2**32 - 1},
        {"step": 0},
        {"step": 2**32 - 1},
    ],
)
def test_inconsistent_image_sizes_are_refused(change):
    image = image_message(np.zeros((2, 2), np.uint8), "mono8", "camera", NOW)
    for name, value in change.items():
        setattr(image, name, value)
    with pytest.raises(ConversionError):
        image_array(image)


def test_empty_image_has_no_pixels():
    assert image_array(Image(encoding="rgb8")).shape == (0, 0, 3)


@pytest.mark.parametrize(
    ("pixels", "encoding"),
    [
        (np.zeros((2, 2, 3), np.uint8), "mono8"),
        (np.zeros((2, 2), np.uint8), "rgb8"),
        (np.zeros((2, 2)), "mono8"),
        (np.zeros(4, np.uint8), "mono8"),
        (np.zeros((2, 2), np.uint8), "yuv422"),
    ],
)
def test_arrays_that_do_not_fit_the_encoding_are_refused(pixels, encoding):
    with pytest.raises(ConversionError):
        image_message(pixels, encoding, "camera", NOW)
