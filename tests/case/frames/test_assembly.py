"""Samples become frames: assembly, frames for gaps, and reading ahead."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.case import with_watchdog
from app.case.frame_streams import (
    AHEAD,
    REORDER_NS,
    FrameAssembler,
    JointSample,
    TrackingFrame,
    read_ahead,
)
from app.geometry import InputError, Stamp, TrackedTransform, TrackingStatus, Transform

STALE_NS = 200


def sample(ns: int, status: int = 1) -> TrackedTransform:
    return TrackedTransform.lost("a", "b", Stamp(ns), TrackingStatus(status))


def joints(ns: int) -> JointSample:
    return JointSample(("j",), np.zeros(1), Stamp(ns))


def stamps(frames) -> list[int]:
    return [frame.stamp.ns for frame in frames]


@pytest.fixture
def notes() -> list[str]:
    return []


@pytest.fixture
def assembler(notes) -> FrameAssembler:
    return FrameAssembler(notes.append)


def test_frame_is_complete_once_no_older_sample_can_arrive(assembler):
    assert list(assembler.add_pose(sample(0))) == []
    assert list(assembler.add_pose(sample(REORDER_NS))) == []
    assert stamps(assembler.add_pose(sample(REORDER_NS + 1))) == [0]
    assert stamps(assembler.flush()) == [REORDER_NS, REORDER_NS + 1]


def good(x_mm: float) -> TrackedTransform:
    return TrackedTransform.valid(Transform("a", "b", np.eye(3), [x_mm, 0.0, 0.0]), Stamp(0))


@pytest.mark.parametrize(
    ("samples", "status", "noted"),
    [
        ((sample(0), sample(0, status=2)), "INVALID", []),
        ((good(1.0), good(1.0)), "OK", []),
        ((good(1.0), good(2.0), good(2.0)), "INVALID", ["two poses"]),
        ((good(1.0), sample(0)), "INVALID", []),
        ((sample(0), good(1.0)), "INVALID", []),
    ],
    ids=["the first one counts", "repeated", "contradiction", "lost last", "lost first"],
)
def test_samples_of_one_edge_and_time_become_one(assembler, notes, samples, status, noted):
    for each in samples:
        assert list(assembler.add_pose(each)) == []
    ((one,),) = (frame.poses for frame in assembler.flush())
    assert (one.status.name, one.transform is None) == (status, status != "OK")
    assert len(notes) == len(noted)
    assert all(text in note for text, note in zip(noted, notes, strict=True))


def test_joints_go_with_the_first_frame_not_older_and_the_rest_with_the_last(assembler):
    for ns in (30, 10, 25, 20, 5):
        assembler.add_joints(joints(ns))
    for ns in (10, 20):
        assert list(assembler.add_pose(sample(ns))) == []
    assert [[j.stamp.ns for j in f.joints] for f in assembler.flush()] == [[5, 10], [20, 25, 30]]


def test_clock_jump_back_flushes_the_buffer(assembler):
    far = 10 * REORDER_NS
    assert list(assembler.add_pose(sample(far))) == []
    assert stamps(assembler.add_pose(sample(0))) == [far]
    assert stamps(assembler.flush()) == [0]


def test_joints_without_frames_do_not_accumulate(assembler, notes):
    one = joints(10**15)
    for _ in range(250_000):
        assembler.add_joints(one)
    assert list(assembler.add_pose(sample(0))) == []
    (frame,) = assembler.flush()
    assert len(frame.joints) <= 100_000
    assert len(notes) == 1 and "offset_robot_to_tracker_ms" in notes[0]


def frame(ns: int, *joint_ns: int) -> TrackingFrame:
    return TrackingFrame(Stamp(ns), (sample(ns),), tuple(map(joints, joint_ns)))


@pytest.mark.parametrize(
    ("frames", "watched"),
    [
        ([frame(0), frame(200), frame(401, 250, 401), frame(2000)],
         [(0, 1), (200, 1), (401, 0, 250, 401), (401, 1), (602, 0), (2000, 1)]),
        ([frame(0), frame(1000, 100, 201, 202, 900)],
         [(0, 1), (201, 0, 100, 201), (1000, 1, 202, 900)]),
        ([frame(0, 0, 50, 300)], [(0, 1, 0, 50), (201, 0, 300)]),
        ([frame(0, 0, 50, 200)], [(0, 1, 0, 50, 200)]),
        ([frame(5000), frame(0)], [(5000, 1), (0, 1)]),
    ],
    ids=["one frame", "its joints are split", "at the end", "no gap at the end", "clock jump"],
)  # fmt: skip
def test_a_gap_gets_one_frame_without_poses(frames, watched):
    """Stamp, number of poses and stamps of the joints of each frame."""
    found = with_watchdog(iter(frames), STALE_NS)
    assert [(f.stamp.ns, len(f.poses), *(j.stamp.ns for j in f.joints)) for f in found] == watched


@given(st.lists(st.integers(0, 2000), min_size=1, max_size=30, unique=True))
def test_frames_are_never_farther_apart_than_allowed(times):
    times.sort()
    watched = list(with_watchdog(iter([frame(ns) for ns in times]), STALE_NS))
    assert [f.stamp.ns for f in watched if f.poses] == times
    for one, other in pairwise(watched):
        if one.poses and other.poses:
            assert 0 < other.stamp.ns - one.stamp.ns <= STALE_NS
        assert one.poses or other.poses


def counted(count: int, read: list[int]):
    for ns in range(count):
        read.append(ns)
        yield TrackingFrame(Stamp(ns), ())


@pytest.mark.parametrize("count", [0, 1, AHEAD, AHEAD + 1, 3 * AHEAD])
def test_frames_that_are_read_ahead_are_yielded_in_order(count):
    assert stamps(read_ahead(counted(count, []))) == list(range(count))


def test_one_block_is_read_for_the_first_frame():
    read = []
    next(read_ahead(counted(10 * AHEAD, read)))
    assert len(read) == AHEAD


def test_reader_error_is_raised_after_the_frames_before_it():
    def broken():
        yield from counted(AHEAD + 5, [])
        raise InputError("no more")

    ahead = read_ahead(broken())
    assert [next(ahead).stamp.ns for _ in range(AHEAD + 5)] == list(range(AHEAD + 5))
    with pytest.raises(InputError, match="no more"):
        next(ahead)
