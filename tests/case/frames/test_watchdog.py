from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.case import JointSample, TrackingFrame, with_watchdog
from app.geometry import Stamp, TrackedTransform, TrackingStatus

STALE_NS = 200


def frame(ns: int, *joint_ns: int) -> TrackingFrame:
    sample = TrackedTransform.lost("a", "b", Stamp(ns), TrackingStatus.INVALID)
    joints = tuple(JointSample(("j",), np.zeros(1), Stamp(n)) for n in joint_ns)
    return TrackingFrame(Stamp(ns), (sample,), joints)


def shown(frames: list[TrackingFrame]) -> list[tuple[int, int, list[int]]]:
    watched = with_watchdog(iter(frames), STALE_NS)
    return [(f.stamp.ns, len(f.poses), [j.stamp.ns for j in f.joints]) for f in watched]


def test_a_gap_gets_one_frame_without_poses() -> None:
    frames = [frame(0), frame(200), frame(401, 250, 401), frame(2000)]
    assert shown(frames) == [
        (0, 1, []),
        (200, 1, []),
        (401, 0, [250, 401]),
        (401, 1, []),
        (602, 0, []),
        (2000, 1, []),
    ]


def test_joints_of_a_gap_are_split_between_its_frames() -> None:
    frames = [frame(0), frame(1000, 100, 201, 202, 900)]
    assert shown(frames) == [(0, 1, []), (201, 0, [100, 201]), (1000, 1, [202, 900])]


def test_joints_after_the_last_frame_reveal_a_gap_at_the_end() -> None:
    assert shown([frame(0, 0, 50, 300)]) == [(0, 1, [0, 50]), (201, 0, [300])]
    assert shown([frame(0, 0, 50, 200)]) == [(0, 1, [0, 50, 200])]


def test_clock_jump_back_is_not_a_gap() -> None:
    assert shown([frame(5000), frame(0)]) == [(5000, 1, []), (0, 1, [])]


@given(st.lists(st.integers(0, 2000), min_size=1, max_size=30, unique=True))
def test_frames_are_never_farther_apart_than_allowed(stamps: list[int]) -> None:
    stamps.sort()
    watched = list(with_watchdog(iter([frame(ns) for ns in stamps]), STALE_NS))
    assert [f.stamp.ns for f in watched if f.poses] == stamps
    for one, other in pairwise(watched):
        if one.poses and other.poses:
            assert 0 < other.stamp.ns - one.stamp.ns <= STALE_NS
        assert one.poses or other.poses
