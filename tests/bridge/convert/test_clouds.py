"""Conversion of point clouds, including other layouts and invalid ones."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from sensor_msgs.msg import PointCloud2, PointField

from app.bridge.convert import ConversionError, cloud_array, cloud_message, cloud_points_mm
from app.geometry import Stamp

pytestmark = pytest.mark.slow

COORDINATES = st.floats(-1e4, 1e4)


@given(arrays.arrays(float, st.tuples(st.integers(0, 20), st.just(3)), elements=COORDINATES))
def test_points_converted_there_and_back_are_equal(points):
    message = cloud_message(points, "scanner", Stamp(5))
    assert np.allclose(cloud_points_mm(message), points, rtol=1e-6, atol=1e-6)
    # Independent read of the bytes.
    numbers = struct.unpack(f"<{3 * len(points)}f", bytes(message.data))
    assert np.allclose(numbers, points.ravel() / 1000.0, rtol=1e-6, atol=1e-9)


def cloud(**changes):
    """Two rows of one point: a colour, then y, x, z as 64-bit big-endian floats, then padding."""
    fields = [("rgb", 0, 7), ("y", 4, 8), ("x", 12, 8), ("z", 20, 8)]
    message = PointCloud2(height=2, width=1, point_step=30, row_step=32, is_bigendian=True)
    message.fields = [
        PointField(name=name, offset=offset, datatype=kind, count=1)
        for name, offset, kind in fields
    ]
    for number in (1.0, 10.0):
        message.data.frombytes(
            struct.pack(">f3d", 0.5, 2.0 * number, number, 3.0 * number) + bytes(4)
        )
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def test_other_field_layout_is_read():
    assert cloud_points_mm(cloud()).tolist() == [[1e3, 2e3, 3e3], [1e4, 2e4, 3e4]]
    assert cloud_array(cloud())["rgb"].tolist() == [0.5, 0.5]


def test_points_without_measurement_stay_nan():
    points = np.array([[1.0, 2.0, 3.0], [np.nan] * 3])
    message = cloud_message(points, "scanner", Stamp(5))
    assert not message.is_dense
    assert np.isnan(cloud_points_mm(message)[1]).all()


@pytest.mark.parametrize(
    "changes",
    [
        {"width": 2**32 - 1},
        {"height": 2**32 - 1},
        {"point_step": 2**32 - 1},
        {"point_step": 8},
        {"row_step": 0},
        {"fields": [PointField(name="x", offset=2**32 - 1, datatype=7, count=1)]},
        {"fields": [PointField(name="x", offset=0, datatype=7, count=2**32 - 1)]},
        {"fields": [PointField(name="x", offset=0, datatype=0, count=1)]},
        {"fields": [PointField(name="x", offset=0, datatype=7, count=1)] * 2},
        {"fields": [PointField(name="x", offset=0, datatype=7, count=1)]},
        {"fields": []},
    ],
)
def test_inconsistent_clouds_are_refused(changes):
    with pytest.raises(ConversionError):
        cloud_points_mm(cloud(**changes))
