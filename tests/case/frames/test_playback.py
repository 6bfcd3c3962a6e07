"""Playback in simulated time: stamps of now, recorded intervals, seams of a loop."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.case import JointSample, Playback, TrackingFrame
from app.geometry import InputError, Stamp, TrackedTransform, TrackingStatus, Transform

MS = 1_000_000
HOST_MS = 9_000_000
OFFSET_MS = 37
"""Offset of the robot's clock: tracker = robot + offset."""


class Time:
    """Steady clock and clock of the host, which advance only while waiting."""

    def __init__(self):
        self.ns = 5_000 * MS

    def clock_ns(self):
        return self.ns

    def host_ns(self):
        return self.ns + (HOST_MS - 5_000) * MS

    def wait(self, event, timeout_s):
        assert not event.is_set()
        assert timeout_s is not None
        self.ns += max(1, round(timeout_s * 1e9))


def pose(ms, child="cautery", status=TrackingStatus.OK):
    stamp = Stamp(round(ms * MS))
    if status is TrackingStatus.OK:
        return TrackedTransform.valid(Transform.identity("tracker", child), stamp)
    return TrackedTransform.lost("tracker", child, stamp, status)


def joints(ms):
    return JointSample(("waist",), (0.001 * ms,), Stamp(round(ms * MS)))


def frame(ms, *joint_ms, status=TrackingStatus.OK):
    poses = (pose(ms, "needle"), pose(ms, status=status))
    return TrackingFrame(poses[0].stamp, poses, tuple(map(joints, joint_ms)))


def make(frames, **given):
    time = Time()
    playback = Playback(
        lambda: iter(frames),
        offset_robot_to_tracker_ns=OFFSET_MS * MS,
        clock_ns=time.clock_ns,
        host_ns=time.host_ns,
        wait=time.wait,
        **given,
    )
    return playback, time


def played(playback, time, count=1000):
    """(time of the host, stamps of poses, stamps of joints) in ms since the start."""
    found = []
    for samples in playback.play():
        at_ms = time.host_ns() / MS - HOST_MS
        poses = [sample.stamp.ns / MS - HOST_MS for sample in samples.poses]
        robot = [sample.stamp.ns / MS - HOST_MS for sample in samples.joints]
        found.append((at_ms, poses, robot))
        if len(found) == count:
            playback.stop()
    return found


def test_samples_come_when_due_with_stamps_of_the_host():
    frames = [frame(100), frame(120, 105, 112), frame(140, 130)]
    assert played(*make(frames)) == [
        (0, [0, 0], []),
        (5, [], [5 - OFFSET_MS]),
        (12, [], [12 - OFFSET_MS]),
        (20, [20, 20], []),
        (30, [], [30 - OFFSET_MS]),
        (40, [40, 40], []),
    ]


def test_every_status_and_every_value_is_as_recorded():
    frames = [frame(100, status=TrackingStatus.INVALID), frame(120, status=TrackingStatus.MISSING)]
    first, second = list(make(frames)[0].play())
    assert [sample.status for sample in first.poses] == [TrackingStatus.OK, TrackingStatus.INVALID]
    assert second.poses[1].status is TrackingStatus.MISSING
    assert second.poses[1].transform is None
    assert first.poses[0].transform is frames[0].poses[0].transform
    (moved,) = list(make([frame(100), frame(120, 110)])[0].play())[1].joints
    assert moved.as_mapping() == {"waist": 0.11}


def test_intervals_are_divided_by_the_rate():
    found = played(*make([frame(100), frame(120, 110)], rate=2.0))
    assert found == [(0, [0, 0], []), (5, [], [5 - OFFSET_MS]), (10, [10, 10], [])]


@pytest.mark.parametrize(
    ("stamps", "options", "times"),
    [
        ((100, 120, 140), {}, [0, 20, 40, 1040, 1060, 1080, 2080]),
        ((0, 20), {"rate": 4.0}, [0, 5, 1005]),
        ((100, 120, 140), {"start_s": 0.03}, [0, 1000, 2000]),
    ],
    ids=["seams of a loop", "the pause has no rate", "each pass begins at the start"],
)
def test_stamps_increase_across_the_pause_between_passes(stamps, options, times):
    playback, time = make([frame(ms) for ms in stamps], loop=True, pause_ns=1000 * MS, **options)
    found = played(playback, time, count=len(times))
    assert [(at, poses) for at, poses, _ in found] == [(at, [at, at]) for at in times]


def test_late_joint_sample_is_played_at_once_and_delays_nothing():
    found = played(*make([frame(100), frame(120, 95), frame(140)]))
    assert found == [
        (0, [0, 0], []),
        (0, [], [-5 - OFFSET_MS]),
        (20, [20, 20], []),
        (40, [40, 40], []),
    ]


def test_start_after_the_end_and_values_out_of_range_are_refused():
    playback, _ = make([frame(100), frame(120)], start_s=0.1, loop=True)
    with pytest.raises(InputError, match=r"start of a playback is 0\.1 s; expected"):
        list(playback.play())
    for options in ({"rate": 0.0}, {"start_s": -1.0}, {"start_s": float("nan")}):
        with pytest.raises(InputError):
            make([frame(100)], **options)


def test_stop_ends_the_playback_while_it_waits():
    frames = [frame(0), frame(3_600_000)]
    playback = Playback(
        lambda: iter(frames),
        offset_robot_to_tracker_ns=0,
        clock_ns=lambda: 0,
        host_ns=lambda: 0,
        wait=lambda event, timeout_s: (playback.stop(), event.wait(60.0)),
    )
    assert len(list(playback.play())) == 1


@given(st.lists(st.integers(1, 300), min_size=1, max_size=20), st.sampled_from([0.5, 1.0, 3.0]))
def test_no_stamp_is_repeated_or_from_the_future(intervals_ms, rate):
    stamps = [sum(intervals_ms[:index]) for index in range(len(intervals_ms))]
    playback, time = make([frame(ms) for ms in stamps], loop=True, rate=rate)
    found = played(playback, time, count=3 * len(stamps))
    poses = [stamp for _, (stamp, _), _ in found]
    assert all(earlier < later for earlier, later in pairwise(poses))
    assert all(stamp <= at for at, (stamp, _), _ in found)
