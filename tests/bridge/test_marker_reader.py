"""Markers that were read as bytes are those of rclpy."""

import numpy as np
import pytest
from geometry_msgs.msg import Point
from rclpy.serialization import serialize_message
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray, UVCoordinate

from app.bridge.ros_errors import BridgeError
from app.bridge.world_client import read_marker_array

pytestmark = pytest.mark.slow


def marker(name, points, **more):
    found = Marker(header=Header(frame_id=f"truth/{name}"), ns=name, type=Marker.TRIANGLE_LIST)
    found.points = [Point(x=x, y=y, z=z) for x, y, z in points]
    for key, value in more.items():
        setattr(found, key, value)
    return found


def message():
    rng = np.random.default_rng(3)
    plain = marker("chest", rng.normal(size=(6, 3)).tolist(), text="fixed body")
    full = marker("b", rng.normal(size=(3, 3)).tolist(), text="tissue", mesh_resource="file://x")
    full.colors = [ColorRGBA(r=0.5)] * 3
    full.texture.data = bytes(5)
    full.texture.format = "png"
    full.uv_coordinates = [UVCoordinate(u=0.5, v=0.25)] * 2
    full.mesh_file.filename = "odd"
    full.mesh_file.data = bytes(3)
    full.mesh_use_embedded_materials = True
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL), plain, full, plain])


def test_reads_what_rclpy_has_written():
    sent = message()
    found = read_marker_array(bytes(serialize_message(sent)))
    assert [(e.action, e.type, e.name, e.text) for e in found] == [
        (e.action, e.type, e.ns, e.text) for e in sent.markers
    ]
    for each, of in zip(found, sent.markers, strict=True):
        points = np.array([[p.x, p.y, p.z] for p in of.points]).reshape(-1, 3)
        np.testing.assert_array_equal(each.points_m, points)


def test_every_shorter_message_is_refused():
    data = bytes(serialize_message(message()))
    whole = len(read_marker_array(data))
    for length in range(len(data) - 4):
        with pytest.raises(BridgeError, match="expected a MarkerArray"):
            read_marker_array(data[:length])
    assert whole == 4


def test_large_counts_are_refused_at_once():
    data = bytearray(serialize_message(message()))
    data[4:8] = b"\xff\xff\xff\xff"
    with pytest.raises(BridgeError, match="4294967295 markers"):
        read_marker_array(bytes(data))
