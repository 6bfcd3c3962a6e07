from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.fixture import Reason
from app.geometry import (
    NS_PER_MS,
    FrameError,
    FreshnessLimits,
    Stamp,
    StampError,
    TrackedTransform,
    Transform,
)
from app.geometry import TrackingStatus as Status
from app.session.pose_tree import PoseRules, PoseTree
from app.session.tracked_edges import REASON_OF_STATUS
from tests.doubles import frame, lost, sample

TOOL, TUMOR, REFERENCE = (("tracker", name) for name in ("cautery", "needle", "reference"))
BETWEEN = ("needle", "cautery")


class Tree(PoseTree):
    """A tree with the limits of the tests, which takes poses that are stamped with their frame."""

    def __init__(self) -> None:
        limits = FreshnessLimits(200 * NS_PER_MS, frozen_after_ns=1000 * NS_PER_MS)
        super().__init__(PoseRules(limits, moving_frames=("cautery", "needle")))

    def put(self, at_ms, *edges, **places):
        """Insert a frame of x in mm by name, and of edges (parent, child, (x, y, z), stamp)."""
        named = (sample("tracker", name, (x, 0, 0), at_ms) for name, x in places.items())
        return self.insert(frame(at_ms, *named, *(sample(*edge) for edge in edges)))

    def put_lost(self, at_ms, status):
        return self.insert(frame(at_ms, lost(*TOOL, at_ms, status)))

    def repeat(self, end_ms, edge=TOOL, begin_ms=0, x=0):
        for at_ms in range(begin_ms, end_ms + 1, 50):
            self.put(at_ms, (*edge, (x, 0, 0), at_ms))

    def problems(self, edge=TOOL):
        return self.pose(*edge).problems


@pytest.fixture
def tree() -> Tree:
    return Tree()


@st.composite
def chains(draw):
    """A chain of frames f0..fn whose edges are measured in either direction."""
    edges = []
    for index in range(draw(st.integers(1, 6))):
        turn = draw(st.tuples(*[st.floats(-3.0, 3.0)] * 3))
        move = draw(st.tuples(*[st.floats(-100.0, 100.0)] * 3))
        ends = {"target": f"f{index}", "source": f"f{index + 1}"}
        edges.append((Transform.from_rotation_vector(turn, move, **ends), draw(st.booleans())))
    return edges


@given(chains())
def test_pose_is_the_product_of_the_matrices_along_the_path(chain):
    tree = PoseTree(PoseRules(FreshnessLimits(10**9, 10**9), ()))
    product = np.eye(4)
    for step, turned in chain:
        product = product @ step.matrix
        measured = step.inverse() if turned else step
        tree.insert(frame(0, TrackedTransform(measured, Stamp(0), Status.OK)))
    found = tree.pose("f0", f"f{len(chain)}")
    assert found.problems == frozenset()
    np.testing.assert_allclose(found.transform.matrix, product, atol=1e-9)
    assert (found.transform.target, found.transform.source) == ("f0", f"f{len(chain)}")


def test_shortest_path_is_used(tree):
    tree.put(0, (*BETWEEN, (1, 2, 3), 0), cautery=9, needle=0)
    np.testing.assert_array_equal(tree.pose(*BETWEEN).transform.translation_mm, [1, 2, 3])


def test_frame_that_was_never_measured_is_missing(tree):
    assert tree.problems() == {Reason.MISSING}
    tree.put(0, cautery=0)
    found = tree.pose(*BETWEEN)
    assert (found.transform, found.oldest, found.problems) == (None, None, {Reason.MISSING})


@pytest.mark.parametrize("status", [status for status in Status if status])
def test_lost_sample_is_a_problem_at_once(tree, status):
    tree.put(0, cautery=0)
    tree.put_lost(20, status)
    found = tree.pose(*TOOL)
    assert found.transform is None
    assert found.problems == {REASON_OF_STATUS[status]}


def test_reasons_of_all_edges_on_the_path_are_collected(tree):
    tree.put(0, needle=0, cautery=0)
    tree.put_lost(201, Status.INVALID)
    assert tree.problems(BETWEEN) == {Reason.STALE, Reason.INVALID}
    assert tree.problems(("needle", "tracker")) == {Reason.STALE}


def test_pose_is_stale_just_after_its_limit_and_has_the_oldest_stamp(tree):
    tree.put(0, needle=0, cautery=0)
    tree.put(200, cautery=1)
    found = tree.pose(*BETWEEN)
    assert (found.problems, found.oldest) == (frozenset(), Stamp(0))
    tree.put(200.001, cautery=2)
    assert tree.problems(BETWEEN) == {Reason.STALE}


def test_watchdog_frame_makes_all_poses_stale(tree):
    tree.put(0, cautery=0)
    tree.put(201)
    assert tree.problems() == {Reason.STALE}


@pytest.mark.parametrize("edge", [TOOL, TUMOR])
def test_moving_frames_that_repeat_are_frozen_from_the_first_frame_on(tree, edge):
    tree.repeat(1000, edge)
    assert tree.problems(edge) == set()
    tree.repeat(1050, edge, begin_ms=1050)
    assert tree.problems(edge) == {Reason.FROZEN}
    tree.put(1100, (*edge, (0, 0, 1e-9), 1100))
    assert tree.problems(edge) == set()


def test_stuck_tumour_is_frozen_while_the_tool_moves(tree):
    for at_ms in range(0, 1101, 50):
        tree.put(at_ms, needle=0, cautery=at_ms)
    assert tree.problems(BETWEEN) == {Reason.FROZEN}


def test_sample_that_arrives_after_a_newer_one_is_ignored(tree):
    tree.put(100, cautery=2)
    tree.put(110, (*TOOL, (1, 0, 0), 80))
    found = tree.pose(*TOOL)
    assert found.oldest == Stamp(100 * NS_PER_MS)
    assert found.transform.translation_mm.tolist() == [2, 0, 0]


def test_late_duplicate_does_not_end_a_frozen_run(tree):
    tree.repeat(1050)
    tree.put(1060, (*TOOL, (0, 0, 0), 900))
    assert tree.problems() == {Reason.FROZEN}


def test_unchanged_time_is_measured_by_stamps_and_not_by_arrival(tree):
    """The sample with the change arrived 100 ms late."""
    tree.put(0, cautery=1)
    tree.put(100, (*TOOL, (0, 0, 0), 0))
    tree.repeat(1000, begin_ms=150)
    assert tree.pose(*TOOL).unchanged_ns == 1000 * NS_PER_MS


def test_sample_from_the_future_is_not_used_and_does_not_block_later_ones(tree):
    for stamp_ms in (1, 10**6):
        tree.put(0, (*TOOL, (1, 0, 0), stamp_ms))
        assert tree.problems() == {Reason.FUTURE_STAMP}
    tree.put(20, cautery=2)
    assert tree.problems() == set()


def test_future_stamp_does_not_prevent_frozen(tree):
    tree.put(0, (*TOOL, (0, 0, 0), 10_000))
    tree.repeat(1050, begin_ms=50)
    assert tree.problems() == {Reason.FROZEN}


def test_inverted_edge_of_a_moving_frame_is_frozen_as_well(tree):
    tree.repeat(1100, TOOL[::-1])
    assert tree.problems(TOOL[::-1]) == {Reason.FROZEN}


@pytest.mark.parametrize("number", [-3.697314e28, 10_001.0])
def test_pose_beyond_the_largest_translation_is_invalid(tree, number):
    tree.put(0, (*TOOL, (0, 0, number), 0))
    assert tree.problems() == {Reason.INVALID}


def test_stuck_sensor_stays_frozen_after_a_clock_jump(tree):
    tree.put(5000, needle=1)
    tree.put(5050, needle=2)
    tree.repeat(1100, TUMOR, x=2)
    assert tree.problems(TUMOR) == {Reason.FROZEN}


def test_other_edge_can_freeze_once_it_has_moved(tree):
    tree.put(0, reference=1)
    tree.repeat(1100, REFERENCE, begin_ms=50)
    assert tree.problems(REFERENCE) == {Reason.FROZEN}
    assert tree.pose(*REFERENCE).unchanged_ns == 1050 * NS_PER_MS


def test_edge_that_never_moved_is_listed_as_fixed(tree):
    tree.repeat(5000, REFERENCE)
    assert (tree.problems(REFERENCE), tree.pose(*REFERENCE).unchanged_ns) == (set(), 0)
    assert tree.never_changed() == (REFERENCE,)


@pytest.mark.parametrize("how", ["status", "number"])
def test_lost_samples_in_between_do_not_end_a_frozen_run(tree, how):
    for at_ms in range(0, 1101, 50):
        if at_ms % 100 == 0:
            tree.put(at_ms, cautery=0)
        elif how == "status":
            tree.put_lost(at_ms, Status.INVALID)
        else:
            tree.put(at_ms, (*TOOL, (0, 0, -3.7e28), at_ms))
    assert tree.problems() == {Reason.FROZEN}


def test_path_that_other_rules_check_is_checked_from_the_next_frame_on(tree):
    rules = PoseRules(tree.limits, moving_frames=("cautery", "needle"))
    tree.put(0, cautery=0, needle=0)
    tree.put(10, cautery=500, needle=0)
    assert tree.implausible() == {}  # nothing is checked
    tree.use(replace(rules, checked=(BETWEEN,)))
    tree.put(20, cautery=500, needle=0)
    tree.put(30, cautery=0, needle=0)
    assert list(tree.implausible()) == ["tracker -> cautery"]


def test_clock_jump_drops_all_samples(tree):
    tree.put(1000, needle=0)
    assert tree.put(0, cautery=0) == {Reason.CLOCK_JUMPED_BACK}
    assert tree.problems(BETWEEN) == {Reason.MISSING}
    assert tree.problems() == set()
    assert tree.put(0, cautery=1) == set()


def test_sample_of_another_clock_changes_nothing(tree):
    tree.put(1000, needle=0, cautery=1)
    before = tree.pose(*BETWEEN)
    other = TrackedTransform.lost("tracker", "probe", Stamp(0, "robot"), Status.MISSING)
    with pytest.raises(StampError, match="of the clocks 'robot' and 'tracker'"):
        tree.insert(frame(0, sample(*TOOL, (5, 0, 0), 0), other))
    after = tree.pose(*BETWEEN)
    assert after.oldest == before.oldest
    np.testing.assert_array_equal(after.transform.matrix, before.transform.matrix)
    assert tree.known_frames() == ("cautery", "needle", "tracker")
    assert tree.put(1020, cautery=1) == set()


def test_fixed_poses_are_multiplied_from_both_sides_on_every_path(tree):
    turn = {"target": "tip", "source": "needle"}
    outer = Transform.from_rotation_vector((0.1, 0.2, 0.3), (4.0, 5.0, 6.0), **turn)
    tree.put(0, needle=3, cautery=7)
    expected = outer.matrix @ tree.pose(*BETWEEN).transform.matrix
    for number in range(50):
        inner = Transform("cautery", f"end_{number}", np.eye(3), (0.0, number, 0.0))
        found = tree.pose(*BETWEEN, outer, inner).transform
        assert (found.target, found.source) == ("tip", f"end_{number}")
        np.testing.assert_allclose(found.matrix, expected @ inner.matrix, atol=1e-12)
    with pytest.raises(FrameError, match="cannot be multiplied"):
        tree.pose(*TOOL, outer, inner)


def test_pose_of_an_earlier_frame_keeps_its_numbers(tree):
    tree.put(0, cautery=1)
    before = tree.pose(*TOOL).transform
    tree.put(20, cautery=2)
    assert before.translation_mm.tolist() == [1, 0, 0]
    assert tree.pose(*TOOL).transform.translation_mm.tolist() == [2, 0, 0]
    with pytest.raises(ValueError, match="read-only"):
        before.translation_mm[0] = 3.0
