"""Edges that a step publishes, and their stamps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.bridge.publishing.serialized import FrameTree, moving_edges
from app.case.frame_streams import TrackingFrame
from app.fixture import FixtureDecision, MarginState
from app.geometry import FrameError, Stamp, TrackedTransform, TrackingStatus, Transform
from app.session import StepResult

pytestmark = pytest.mark.slow


def stamps(edges):
    return {(edge.target, edge.source): stamp.ns for edge, stamp in edges}


def test_every_edge_has_the_stamp_of_its_sample(make_step):
    step = make_step(0)
    now_ns = step.frame.stamp.ns
    assert stamps(moving_edges(step)) == {
        ("tracker", "cautery"): now_ns,
        ("reference", "needle"): now_ns - 3_000_000,
        ("base_link", "stylus"): now_ns - 5_000_000,
        ("tumor", "virtual_fixture"): now_ns - 3_000_000,
    }


def test_measured_edges_are_not_changed(make_step):
    step = make_step(4)
    (cautery,) = (edge for edge, _ in moving_edges(step) if edge.source == "cautery")
    assert np.array_equal(cautery.translation_mm, [104.0, -20.0, 30.0])


def test_lost_pose_has_no_edge_and_old_planes_keep_their_stamp(make_step):
    children = {edge.source for edge, _ in moving_edges(make_step(0, lost=True))}
    assert children == {"needle", "stylus"}


def test_without_joints_no_link_is_published(make_step):
    step = replace(make_step(0), joints=None)
    assert "stylus" not in {edge.source for edge, _ in moving_edges(step)}


def test_repeated_sample_is_published_once(make_step):
    tree = FrameTree()
    first, second = make_step(0), make_step(1)
    tree.new_edges(first)
    repeated = replace(second, joints=first.joints)
    assert ("base_link", "stylus") not in stamps(tree.new_edges(repeated))
    assert ("base_link", "stylus") in stamps(tree.new_edges(make_step(2)))


def test_seek_back_publishes_all_samples_again(make_step):
    tree = FrameTree()
    tree.new_edges(make_step(5))
    assert stamps(tree.new_edges(make_step(2))) == stamps(moving_edges(make_step(2)))


def test_fixture_frame_is_published_in_every_known_state(make_step):
    for state in (MarginState.NEGATIVE, MarginState.WARNING, MarginState.POSITIVE):
        step = make_step(0, state=state)
        assert ("tumor", "virtual_fixture") in stamps(moving_edges(step))


def measured(now_ns, *edges):
    """Step with these measured edges (parent, child) and nothing else."""
    now = Stamp(now_ns)
    poses = tuple(
        TrackedTransform(Transform.identity(parent, child), now, TrackingStatus.OK)
        for parent, child in edges
    )
    unknown = FixtureDecision(
        state=MarginState.UNKNOWN,
        reasons=(),
        proximity=None,
        margin=None,
        constraint=None,
        hold=True,
        stamp=None,
        seq=0,
    )
    return StepResult(0, TrackingFrame(now, poses), unknown, None, None, {}, None)


def test_second_parent_is_skipped_and_logged():
    tree = FrameTree()
    both = [("tracker", "stylus"), ("reference", "stylus")]
    for now_ns in (1, 2):
        assert list(stamps(tree.new_edges(measured(now_ns, *both)))) == [("tracker", "stylus")]
    assert tree.left_out == {("reference", "stylus"): "'stylus' already has the parent 'tracker'"}


@pytest.mark.parametrize(
    ("edges", "reason"),
    [
        ((("a", "a"),), "'a' is below 'a'"),
        ((("a", "b"), ("b", "c"), ("c", "a")), "'c' is below 'a'; the edge would close a loop"),
        ((("a", "c"), ("b", "c")), "'c' already has the parent 'a'"),
    ],
)
def test_static_edges_that_form_no_tree_are_refused(edges, reason):
    with pytest.raises(FrameError, match=f"static transforms: .*{reason}"):
        FrameTree([Transform.identity(*edge) for edge in edges])


def test_calibration_has_priority_over_a_measured_edge():
    tree = FrameTree([Transform.identity("stylus", "stylus_tip")])
    assert tree.new_edges(measured(1, ("stylus", "stylus_tip"))) == []
    assert ("stylus", "stylus_tip") in tree.left_out


frames = st.sampled_from("abcdef")


@given(
    st.lists(st.tuples(frames, frames), max_size=3),
    st.lists(st.lists(st.tuples(frames, frames), max_size=8), max_size=5),
)
def test_published_edges_always_form_a_tree(static, steps):
    fixed = {child: parent for parent, child in static if parent < child}
    tree = FrameTree([Transform.identity(parent, child) for child, parent in fixed.items()])
    parents = {child: {parent} for child, parent in fixed.items()}
    for number, edges in enumerate(steps):
        for parent, child in stamps(tree.new_edges(measured(number, *edges))):
            assert child not in fixed
            parents.setdefault(child, set()).add(parent)
    assert all(len(found) == 1 for found in parents.values())
    for frame in parents:
        visited = {frame}
        while frame in parents:
            (frame,) = parents[frame]
            assert frame not in visited, "a loop"
            visited.add(frame)
