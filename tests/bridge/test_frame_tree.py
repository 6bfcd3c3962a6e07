"""Which edges a step moves, and with which stamps."""

from dataclasses import replace

import numpy as np

from app.bridge.frame_tree import FrameTree, moving_edges
from app.fixture import MarginState


def stamps(edges):
    return {(edge.target, edge.source): stamp.ns for edge, stamp in edges}


def test_every_edge_has_the_stamp_of_its_own_sample(make_step):
    step = make_step(0)
    now_ns = step.frame.stamp.ns
    assert stamps(moving_edges(step)) == {
        ("tracker", "cautery"): now_ns,
        ("reference", "needle"): now_ns - 3_000_000,
        ("base_link", "stylus"): now_ns - 5_000_000,
        ("tumor", "virtual_fixture"): now_ns - 3_000_000,
    }


def test_measured_edges_are_as_they_were_measured(make_step):
    step = make_step(4)
    (cautery,) = (edge for edge, _ in moving_edges(step) if edge.source == "cautery")
    assert np.array_equal(cautery.translation_mm, [104.0, -20.0, 30.0])


def test_a_lost_pose_has_no_edge_and_an_old_plane_no_new_stamp(make_step):
    children = {edge.source for edge, _ in moving_edges(make_step(0, lost=True))}
    assert children == {"needle", "stylus"}


def test_without_joints_no_link_is_placed(make_step):
    step = replace(make_step(0), joints=None)
    assert "stylus" not in {edge.source for edge, _ in moving_edges(step)}


def test_a_sample_that_comes_twice_is_sent_once(make_step):
    tree = FrameTree()
    first, second = make_step(0), make_step(1)
    tree.news(first)
    repeated = replace(second, joints=first.joints)
    assert ("base_link", "stylus") not in stamps(tree.news(repeated))
    assert ("base_link", "stylus") in stamps(tree.news(make_step(2)))


def test_after_a_seek_back_everything_is_new(make_step):
    tree = FrameTree()
    tree.news(make_step(5))
    assert stamps(tree.news(make_step(2))) == stamps(moving_edges(make_step(2)))


def test_the_fixture_is_sent_in_every_known_state(make_step):
    for state in (MarginState.NEGATIVE, MarginState.WARNING, MarginState.POSITIVE):
        step = make_step(0, state=state)
        assert ("tumor", "virtual_fixture") in stamps(moving_edges(step))
