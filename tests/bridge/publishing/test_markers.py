"""Markers: surfaces as triangles in metres, colours of the state, text."""

from dataclasses import replace

import igl
import numpy as np
import pytest
from geometry_msgs.msg import Point
from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge.publishing.markers import (
    MAX_TRIANGLES,
    PreparedShapes,
    corners_m,
    margin_text,
    serialized,
    simplified,
)
from app.bridge.ros_errors import BridgeError
from app.fixture import MarginState
from benchmarks.fixture_shapes import lobed_tumor

pytestmark = pytest.mark.slow


def surfaces(content, state=MarginState.NEGATIVE):
    return deserialize_message(PreparedShapes(content).surfaces(state), MarkerArray)


def test_marker_triangles_are_those_of_the_mesh_in_metres(content):
    tumor, tool = surfaces(content).markers
    assert tumor.type == tumor.TRIANGLE_LIST
    assert (tumor.header.frame_id, tool.header.frame_id) == ("tumor", "cautery_tip")
    corners = np.array([[point.x, point.y, point.z] for point in tumor.points])
    assert corners.reshape(-1, 3, 3) * 1000.0 == pytest.approx(content.tumor.triangles_mm)
    assert len(tool.points) == 3 * len(content.tool.faces)
    assert (tumor.scale.x, tumor.scale.y, tumor.scale.z) == (1.0, 1.0, 1.0)
    assert tumor.pose.orientation.w == 1.0


@pytest.mark.parametrize(
    ("state", "rgb"),
    [
        (MarginState.NEGATIVE, (0.25, 1.0, 0.2)),
        (MarginState.WARNING, (0.88, 0.62, 0.0)),
        (MarginState.POSITIVE, (0.68, 0.08, 0.08)),
        (MarginState.UNKNOWN, (0.5, 0.5, 0.5)),
    ],
)
def test_tumor_marker_has_the_color_of_the_state(content, state, rgb):
    color = surfaces(content, state).markers[0].color
    assert rgb == state.color
    assert (color.r, color.g, color.b) == pytest.approx(rgb, abs=1e-7)
    assert 0.0 < color.a < 1.0


def test_marker_is_locked_to_its_frame(content):
    for marker in surfaces(content).markers:
        assert marker.frame_locked
        assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == (0, 0)


def test_without_tool_mesh_only_the_tumour_is_published(content):
    markers = surfaces(replace(content, tool=None)).markers
    assert [marker.ns for marker in markers] == ["tumor"]


def test_text_is_above_the_tumour(content, make_step):
    shapes = PreparedShapes(content)
    (marker,) = deserialize_message(shapes.text(make_step(0).decision), MarkerArray).markers
    assert marker.text == "CLEAR +7.5 mm"
    near = shapes.text(make_step(0).decision, "", ["tool 'left' is 3.2 mm away"])
    (warned,) = deserialize_message(near, MarkerArray).markers
    assert warned.text == "CLEAR +7.5 mm\ntool 'left' is 3.2 mm away"
    position = marker.pose.position
    assert (position.x, position.y, position.z) == pytest.approx((0.005, 0.005, 0.02))


def test_known_texts_are_those_of_their_decisions(content, make_step, monkeypatch):
    monkeypatch.setattr("app.bridge.publishing.markers._MAX_TEXTS", 2)
    shapes = PreparedShapes(content)
    steps = [make_step(0), make_step(0, lost=True), make_step(0, state=MarginState.WARNING)]
    for step in [*steps, *steps]:
        expected = PreparedShapes(content).text(step.decision)
        assert deserialize_message(shapes.text(step.decision), MarkerArray) == deserialize_message(
            expected, MarkerArray
        )


def test_text_of_breach_and_unknown(make_step):
    breach = make_step(0, state=MarginState.POSITIVE).decision
    witnesses = replace(breach.proximity.witnesses, signed_distance_mm=np.array([-1.44]))
    proximity = replace(breach.proximity, witnesses=witnesses, lower_bound_mm=-1.44)
    deep = breach._replace(proximity=proximity)
    assert margin_text(deep) == "IN TUMOUR -1.4 mm"
    assert margin_text(make_step(0, lost=True).decision) == "UNKNOWN: invalid, latched"


def test_points_written_as_bytes_are_those_that_rclpy_serialises(content):
    found = PreparedShapes(content).surfaces(MarginState.WARNING)
    expected = deserialize_message(found, MarkerArray)
    for marker, mesh in zip(expected.markers, (content.tumor, content.tool), strict=True):
        marker.points = [Point(x=x, y=y, z=z) for x, y, z in corners_m(mesh).tolist()]
    # Not as bytes: padding is not initialised.
    assert len(found) == len(serialize_message(expected))
    assert deserialize_message(found, MarkerArray) == expected


def test_message_with_points_elsewhere_is_refused():
    with pytest.raises(BridgeError, match="marker 0: its points are not where"):
        serialized(MarkerArray(markers=[Marker()]), [np.zeros((3, 3))])


def test_surface_without_area_is_simplified_in_few_steps(monkeypatch):
    steps = []
    unique = np.unique
    monkeypatch.setattr(np, "unique", lambda *a, **k: steps.append(1) or unique(*a, **k))
    line = np.linspace(0.0, 1000.0, 3000)[:, None] * np.array([[1.0, 0.0, 0.0]])
    faces = np.arange(2998)[:, None] + np.arange(3)

    _, kept = simplified(line, faces, 100)

    assert len(kept) <= 100
    assert len(steps) < 60


def test_large_surface_is_simplified_and_stays_close(content):
    ball = lobed_tumor(80_000)
    marker = surfaces(replace(content, tumor=ball)).markers[0]
    assert 5_000 < len(marker.points) // 3 <= MAX_TRIANGLES
    vertices, faces = simplified(ball.vertices_mm, ball.faces, 1000)
    assert 200 < len(faces) <= 1000
    squared, _, _ = igl.point_mesh_squared_distance(
        vertices, np.array(ball.vertices_mm), ball.faces.astype(np.int64)
    )
    assert np.sqrt(squared).max() < 1.0
    again = simplified(ball.vertices_mm, ball.faces, 1000)
    assert np.array_equal(again[0], vertices)
    assert np.array_equal(again[1], faces)
