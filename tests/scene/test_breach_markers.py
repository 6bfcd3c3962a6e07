import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slicer import vtkMRMLScene

from app.fixture import MarginState
from app.scene import Batch, BreachMarkers, MarkerStyle, SceneError
from app.scene.margin_display import MARK_COLOR
from tests.fixture.control.test_state_display import VISIONS, seen_ratio

pytestmark = pytest.mark.slow

SPACING_MM = MarkerStyle().spacing_mm
POINTS = st.lists(st.tuples(*[st.floats(-4.0, 4.0, width=32)] * 3), max_size=60)


def markers(style=None):
    scene = vtkMRMLScene()
    pose = scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", "Pose")
    return BreachMarkers(scene, Batch(scene), pose, style)


def positions(marks):
    points = [marks.node.GetNthControlPointPosition(place) for place in range(len(marks))]
    return np.array(points).reshape(-1, 3)


@settings(max_examples=30)
@given(POINTS)
def test_marks_keep_their_spacing_and_every_breach_is_near_one(points):
    marks = markers()
    added = [marks.add(np.array(point)) for point in points]
    placed = positions(marks)
    assert sum(added) == len(marks) == len(placed)
    apart = np.linalg.norm(placed[:, None] - placed[None], axis=-1)
    assert (apart[~np.eye(len(placed), dtype=bool)] >= SPACING_MM).all()
    for point in points:
        assert np.linalg.norm(placed - point, axis=1).min() < SPACING_MM
    # A mark is left out only because of an earlier one: the first is always there.
    assert not points or np.array_equal(placed[0], points[0])


def test_points_can_be_marked_again_after_clear():
    marks = markers()
    point = np.array([0.2, 0.3, 0.4])
    assert marks.add(point)
    near = point + np.array([0.0, 0.0, 0.99])
    assert not marks.add(near)
    marks.clear()
    assert len(marks) == 0
    assert marks.add(near)


def test_marks_are_red_and_locked():
    marks = markers()
    assert marks.node.GetName() == "BreachMarkers"
    assert marks.node.GetDisplayNode().GetSelectedColor() == MARK_COLOR
    assert marks.node.GetLocked()


@pytest.mark.parametrize("most", [20, 60])
def test_long_breach_has_at_most_the_maximum_of_marks(most, monkeypatch):
    monkeypatch.setattr("app.scene.margin_display.MAX_MARKS", most)
    marks = markers()
    breach = np.random.default_rng(1).uniform(-8.0, 8.0, (600, 3))
    for place, point in enumerate(breach):
        marks.add(point)
        assert len(marks) <= most
        if place % 50 == 0:
            placed = positions(marks)
            apart = np.linalg.norm(placed[:, None] - placed[None], axis=-1)
            assert (apart[~np.eye(len(placed), dtype=bool)] >= marks.spacing_mm).all()
    assert marks.spacing_mm > SPACING_MM
    for point in breach:
        assert np.linalg.norm(positions(marks) - point, axis=1).min() < 2.0 * marks.spacing_mm
    assert np.array_equal(positions(marks)[0], breach[0])  # the earliest stay
    marks.clear()
    assert marks.spacing_mm == SPACING_MM


@pytest.mark.parametrize("vision", VISIONS)
def test_marks_can_be_seen_on_a_tumor_of_each_state(vision):
    """On red by luminance; on the others by luminance or by a channel that differs by 0.3."""
    assert seen_ratio(MARK_COLOR, MarginState.POSITIVE.color, vision) >= 4.5
    for state in MarginState:
        levels = np.array([MARK_COLOR, state.color])
        linear = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
        seen = np.clip(linear @ VISIONS[vision].T, 0.0, 1.0)
        assert np.abs(seen[0] - seen[1]).max() >= 0.3, state


@settings(max_examples=30)
@given(POINTS, st.floats(0.2, 5.0), st.floats(0.2, 5.0))
def test_another_spacing_applies_to_the_breaches_so_far(points, before_mm, after_mm):
    marks = markers(MarkerStyle(before_mm))
    for point in points:
        marks.add(np.array(point))
    marks.set_style(MarkerStyle(after_mm, 3.0))
    placed = positions(marks)
    assert marks.node.GetDisplayNode().GetGlyphSize() == 3.0
    apart = np.linalg.norm(placed[:, None] - placed[None], axis=-1)
    assert (apart[~np.eye(len(placed), dtype=bool)] >= after_mm).all()
    for point in points:  # those that are nearer than 0.2 mm to another are not kept
        assert np.linalg.norm(placed - point, axis=1).min() < after_mm + 0.2


@pytest.mark.parametrize(
    ("spacing_mm", "size_mm", "message"),
    [
        (0.1, 1.0, "least distance 0.1 mm; expected 0.2 to 20 mm"),
        (float("nan"), 1.0, "least distance nan mm"),
        (1.0, 11.0, "size 11 mm; expected 0.2 to 10 mm"),
    ],
)
def test_style_out_of_range_is_refused(spacing_mm, size_mm, message):
    with pytest.raises(SceneError, match=re.escape(message)):
        MarkerStyle(spacing_mm, size_mm)
