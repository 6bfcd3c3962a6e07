"""A request with a surface as arrays equals rclpy's own conversion of the same bytes."""

import numpy as np
import pytest
from geometry_msgs.msg import Point
from marginguard_msgs.srv import SetStructure, SetTumor
from rclpy.serialization import deserialize_message, serialize_message
from shape_msgs.msg import MeshTriangle

from app.bridge.control.operator_services import (
    ArrayRequest,
    StructureArrayRequest,
    StructureRequest,
    SurfaceRequest,
)

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("is_structure", [False, True])
@pytest.mark.parametrize(
    ("frame", "triangles", "vertices"), [("", 0, 0), ("needle", 1, 0), ("näh\n", 500, 251)]
)
def test_arrays_equal_the_conversion_of_rclpy(frame, triangles, vertices, is_structure):
    rng = np.random.default_rng(triangles)
    kind = SetStructure if is_structure else SetTumor
    request = kind.Request()
    if is_structure:
        request.name, request.role = f"{frame}ß", "target"
        request.stop_distance, request.warn_distance, request.sigma = rng.normal(size=3).tolist()
    request.header.frame_id = frame
    request.header.stamp.nanosec = 2**32 - 1
    position, rotation = request.pose.position, request.pose.orientation
    position.x, position.y, position.z = rng.normal(size=3).tolist()
    rotation.x, rotation.y, rotation.z, rotation.w = rng.normal(size=4).tolist()
    request.mesh.triangles = [
        MeshTriangle(vertex_indices=row)
        for row in rng.integers(2**32, size=(triangles, 3), dtype=np.uint32)
    ]
    request.mesh.vertices = [
        Point(x=x, y=y, z=z) for x, y, z in rng.normal(size=(vertices, 3)).tolist()
    ]
    data = serialize_message(request)
    expected = deserialize_message(data, kind.Request)
    found = deserialize_message(data, StructureArrayRequest if is_structure else ArrayRequest)
    assert type(found) is (StructureRequest if is_structure else SurfaceRequest)
    assert found.frame_id == expected.header.frame_id
    at, turn = expected.pose.position, expected.pose.orientation
    assert found.position_m.tolist() == [at.x, at.y, at.z]
    assert found.quaternion.tolist() == [turn.x, turn.y, turn.z, turn.w]
    assert found.triangles.shape == (triangles, 3)
    assert found.triangles.tolist() == [
        triangle.vertex_indices.tolist() for triangle in expected.mesh.triangles
    ]
    assert found.vertices_m.shape == (vertices, 3)
    assert found.vertices_m.tolist() == [[p.x, p.y, p.z] for p in expected.mesh.vertices]
    if isinstance(found, StructureRequest):
        distances_m = expected.stop_distance, expected.warn_distance, expected.sigma
        assert (found.name, found.role) == (expected.name, expected.role)
        assert (found.stop_m, found.warn_m, found.sigma_m) == distances_m
    assert type(deserialize_message(data, kind.Request)) is kind.Request
