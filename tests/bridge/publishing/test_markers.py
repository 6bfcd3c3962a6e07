"""Markers: surfaces as triangles in metres, colours of the state, text."""

from dataclasses import replace

import numpy as np
import pytest

from app.bridge.publishing.markers import Markers, margin_text
from app.fixture import MarginState


def test_marker_triangles_are_those_of_the_mesh_in_metres(content):
    tumor, tool = Markers(content).surfaces(MarginState.NEGATIVE).markers
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
    color = Markers(content).surfaces(state).markers[0].color
    assert (color.r, color.g, color.b) == rgb == state.color
    assert 0.0 < color.a < 1.0


def test_marker_is_locked_to_its_frame(content):
    for marker in Markers(content).surfaces(MarginState.NEGATIVE).markers:
        assert marker.frame_locked
        assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == (0, 0)


def test_without_tool_mesh_only_the_tumour_is_published(content):
    markers = Markers(replace(content, tool=None)).surfaces(MarginState.NEGATIVE).markers
    assert [marker.ns for marker in markers] == ["tumor"]


def test_text_is_above_the_tumour(content, make_step):
    (marker,) = Markers(content).text(make_step(0).decision).markers
    assert marker.text == "CLEAR +7.5 mm"
    position = marker.pose.position
    assert (position.x, position.y, position.z) == pytest.approx((0.005, 0.005, 0.02))


def test_text_of_breach_and_unknown(make_step):
    breach = make_step(0, state=MarginState.POSITIVE).decision
    witnesses = replace(breach.proximity.witnesses, signed_distance_mm=np.array([-1.44]))
    proximity = replace(breach.proximity, witnesses=witnesses, lower_bound_mm=-1.44)
    deep = replace(breach, proximity=proximity)
    assert margin_text(deep) == "IN TUMOUR -1.4 mm"
    assert margin_text(make_step(0, lost=True).decision) == "UNKNOWN: invalid, latched"
