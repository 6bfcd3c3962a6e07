import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.fixture import Reason
from app.geometry import (
    NS_PER_MS,
    FreshnessLimits,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
)
from app.session.pose_tree import REASON_OF_STATUS, PoseTree
from tests.doubles import frame, lost, sample


@pytest.fixture
def tree() -> PoseTree:
    return PoseTree(
        FreshnessLimits(200 * NS_PER_MS, frozen_after_ns=1000 * NS_PER_MS),
        moving_frames=("cautery", "needle"),
    )


@st.composite
def chains(draw):
    """A chain of frames f0..fn whose edges are measured in either direction."""
    count = draw(st.integers(1, 6))
    edges = []
    for index in range(count):
        turn = draw(st.tuples(*[st.floats(-3.0, 3.0)] * 3))
        move = draw(st.tuples(*[st.floats(-100.0, 100.0)] * 3))
        step = Transform.from_rotation_vector(
            turn, move, target=f"f{index}", source=f"f{index + 1}"
        )
        edges.append((step, draw(st.booleans())))
    return edges


@given(chains())
def test_pose_is_the_product_of_the_matrices_along_the_path(chain):
    tree = PoseTree(FreshnessLimits(10**9, 10**9), ())
    product = np.eye(4)
    for step, turned in chain:
        product = product @ step.matrix
        measured = step.inverse() if turned else step
        tree.insert(frame(0, TrackedTransform(measured, Stamp(0), TrackingStatus.OK)))
    found = tree.pose("f0", f"f{len(chain)}")
    assert found.problems == frozenset()
    np.testing.assert_allclose(found.transform.matrix, product, atol=1e-9)
    assert (found.transform.target, found.transform.source) == ("f0", f"f{len(chain)}")


def test_shortest_path_is_used(tree):
    tree.insert(
        frame(
            0,
            sample("tracker", "cautery", (0, 0, 9), 0),
            sample("tracker", "needle", (0, 0, 0), 0),
            sample("needle", "cautery", (1, 2, 3), 0),
        )
    )
    np.testing.assert_array_equal(
        tree.pose("needle", "cautery").transform.translation_mm, [1, 2, 3]
    )


def test_frame_that_was_never_measured_is_missing(tree):
    assert tree.pose("tracker", "cautery").problems == {Reason.MISSING}
    tree.insert(frame(0, sample("tracker", "cautery", (0, 0, 0), 0)))
    found = tree.pose("needle", "cautery")
    assert (found.transform, found.oldest, found.problems) == (None, None, {Reason.MISSING})


@pytest.mark.parametrize("status", [status for status in TrackingStatus if status])
def test_lost_sample_is_a_problem_at_once(tree, status):
    tree.insert(frame(0, sample("tracker", "cautery", (0, 0, 0), 0)))
    tree.insert(frame(20, lost("tracker", "cautery", 20, status)))
    found = tree.pose("tracker", "cautery")
    assert found.transform is None
    assert found.problems == {REASON_OF_STATUS[status]}


def test_reasons_of_all_edges_on_the_path_are_collected(tree):
    tree.insert(
        frame(
            0,
            sample("tracker", "needle", (0, 0, 0), 0),
            sample("tracker", "cautery", (0, 0, 0), 0),
        )
    )
    tree.insert(frame(201, lost("tracker", "cautery", 201, TrackingStatus.INVALID)))
    assert tree.pose("needle", "cautery").problems == {Reason.STALE, Reason.INVALID}
    assert tree.pose("needle", "tracker").problems == {Reason.STALE}


def test_pose_is_stale_just_after_its_limit_and_has_the_oldest_stamp(tree):
    tree.insert(
        frame(
            0,
            sample("tracker", "needle", (0, 0, 0), 0),
            sample("tracker", "cautery", (0, 0, 0), 0),
        )
    )
    tree.insert(frame(200, sample("tracker", "cautery", (1, 0, 0), 200)))
    found = tree.pose("needle", "cautery")
    assert found.problems == frozenset()
    assert found.oldest == Stamp(0)
    tree.insert(frame(200.001, sample("tracker", "cautery", (2, 0, 0), 200.001)))
    assert tree.pose("needle", "cautery").problems == {Reason.STALE}


def test_watchdog_frame_makes_all_poses_stale(tree):
    tree.insert(frame(0, sample("tracker", "cautery", (0, 0, 0), 0)))
    tree.insert(frame(201))
    assert tree.pose("tracker", "cautery").problems == {Reason.STALE}


def test_sample_from_the_future_is_not_used(tree):
    tree.insert(frame(0, sample("tracker", "cautery", (0, 0, 0), 1)))
    assert tree.pose("tracker", "cautery").problems == {Reason.FUTURE_STAMP}


def frozen_run(tree, edge, end_ms, *, moved_first):
    tree.insert(frame(0, sample(*edge, (1 if moved_first else 0, 0, 0), 0)))
    for at_ms in range(50, end_ms + 1, 50):
        tree.insert(frame(at_ms, sample(*edge, (0, 0, 0), at_ms)))
    return tree.pose(*edge)


@pytest.mark.parametrize("moving", ["cautery", "needle"])
def test_moving_frames_that_repeat_are_frozen_from_the_first_frame_on(tree, moving):
    edge = ("tracker", moving)
    assert frozen_run(tree, edge, 1000, moved_first=False).problems == set()
    tree.insert(frame(1050, sample(*edge, (0, 0, 0), 1050)))
    assert tree.pose(*edge).problems == {Reason.FROZEN}
    tree.insert(frame(1100, sample(*edge, (0, 0, 1e-9), 1100)))
    assert tree.pose(*edge).problems == set()


def test_stuck_tumour_is_frozen_while_the_tool_moves(tree):
    for at_ms in range(0, 1101, 50):
        stuck = sample("tracker", "needle", (0, 0, 0), at_ms)
        tree.insert(frame(at_ms, stuck, sample("tracker", "cautery", (at_ms, 0, 0), at_ms)))
    assert tree.pose("needle", "cautery").problems == {Reason.FROZEN}


def test_sample_that_arrives_after_a_newer_one_is_ignored(tree):
    edge = ("tracker", "cautery")
    tree.insert(frame(100, sample(*edge, (2, 0, 0), 100)))
    tree.insert(frame(110, sample(*edge, (1, 0, 0), 80)))
    found = tree.pose(*edge)
    assert found.oldest == Stamp(100 * NS_PER_MS)
    assert found.transform.translation_mm.tolist() == [2, 0, 0]


def test_late_duplicate_does_not_end_a_frozen_run(tree):
    edge = ("tracker", "cautery")
    frozen_run(tree, edge, 1050, moved_first=False)
    tree.insert(frame(1060, sample(*edge, (0, 0, 0), 900)))
    assert tree.pose(*edge).problems == {Reason.FROZEN}


def test_unchanged_time_is_measured_by_stamps_and_not_by_arrival(tree):
    """The sample with the change arrived 100 ms late."""
    edge = ("tracker", "cautery")
    tree.insert(frame(0, sample(*edge, (1, 0, 0), 0)))
    for at_ms, late_ms in ((100, 100), *((at_ms, 0) for at_ms in range(150, 1001, 50))):
        tree.insert(frame(at_ms, sample(*edge, (0, 0, 0), at_ms - late_ms)))
    assert tree.pose(*edge).unchanged_ns == 1000 * NS_PER_MS


def test_future_stamp_does_not_block_later_samples(tree):
    edge = ("tracker", "cautery")
    tree.insert(frame(0, sample(*edge, (1, 0, 0), 10**6)))
    assert tree.pose(*edge).problems == {Reason.FUTURE_STAMP}
    tree.insert(frame(20, sample(*edge, (2, 0, 0), 20)))
    assert tree.pose(*edge).problems == set()


def test_future_stamp_does_not_prevent_frozen(tree):
    edge = ("tracker", "cautery")
    tree.insert(frame(0, sample(*edge, (0, 0, 0), 10_000)))
    for at_ms in range(50, 1051, 50):
        tree.insert(frame(at_ms, sample(*edge, (0, 0, 0), at_ms)))
    assert tree.pose(*edge).problems == {Reason.FROZEN}


def test_inverted_edge_of_a_moving_frame_is_frozen_as_well(tree):
    found = frozen_run(tree, ("cautery", "tracker"), 1100, moved_first=False)
    assert found.problems == {Reason.FROZEN}


@pytest.mark.parametrize("number", [-3.697314e28, 10_001.0])
def test_pose_beyond_the_largest_translation_is_invalid(tree, number):
    tree.insert(frame(0, sample("tracker", "cautery", (0, 0, number), 0)))
    assert tree.pose("tracker", "cautery").problems == {Reason.INVALID}


def test_stuck_sensor_stays_frozen_after_a_clock_jump(tree):
    edge = ("tracker", "needle")
    tree.insert(frame(5000, sample(*edge, (1, 0, 0), 5000)))
    tree.insert(frame(5050, sample(*edge, (2, 0, 0), 5050)))
    for at_ms in range(0, 1101, 50):
        tree.insert(frame(at_ms, sample(*edge, (2, 0, 0), at_ms)))
    assert tree.pose(*edge).problems == {Reason.FROZEN}


def test_other_edge_can_freeze_once_it_has_moved(tree):
    found = frozen_run(tree, ("tracker", "reference"), 1100, moved_first=True)
    assert found.problems == {Reason.FROZEN}
    assert found.unchanged_ns == 1050 * NS_PER_MS


def test_edge_that_never_moved_is_listed_as_fixed(tree):
    found = frozen_run(tree, ("tracker", "reference"), 5000, moved_first=False)
    assert (found.problems, found.unchanged_ns) == (set(), 0)
    assert tree.never_changed() == (("tracker", "reference"),)


@pytest.mark.parametrize("how", ["status", "number"])
def test_lost_samples_in_between_do_not_end_a_frozen_run(tree, how):
    edge = ("tracker", "cautery")
    for at_ms in range(0, 1101, 50):
        status = lost(*edge, at_ms, TrackingStatus.INVALID)
        if how == "number":
            status = sample(*edge, (0, 0, -3.7e28), at_ms)
        pose = sample(*edge, (0, 0, 0), at_ms)
        tree.insert(frame(at_ms, status if at_ms % 100 else pose))
    assert tree.pose(*edge).problems == {Reason.FROZEN}


def test_clock_jump_drops_all_samples(tree):
    tree.insert(frame(1000, sample("tracker", "needle", (0, 0, 0), 1000)))
    problems = tree.insert(frame(0, sample("tracker", "cautery", (0, 0, 0), 0)))
    assert problems == {Reason.CLOCK_JUMPED_BACK}
    assert tree.pose("needle", "cautery").problems == {Reason.MISSING}
    assert tree.pose("tracker", "cautery").problems == set()
    assert tree.insert(frame(0, sample("tracker", "cautery", (1, 0, 0), 0))) == set()
