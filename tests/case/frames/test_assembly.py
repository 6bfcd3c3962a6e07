import numpy as np

from app.case.frames.assembly import REORDER_NS, FrameAssembler
from app.case.frames.samples import JointSample, TrackingFrame
from app.geometry import Stamp, TrackedTransform, TrackingStatus, Transform


def sample(ns: int, source: str = "b", status: int = 1) -> TrackedTransform:
    return TrackedTransform.lost("a", source, Stamp(ns), TrackingStatus(status))


def joints(ns: int) -> JointSample:
    return JointSample(("j",), np.zeros(1), Stamp(ns))


def stamps(frames: list[TrackingFrame]) -> list[int]:
    return [frame.stamp.ns for frame in frames]


def test_frame_is_complete_once_no_older_sample_can_arrive() -> None:
    assembler = FrameAssembler(lambda _: None)
    assert list(assembler.add_pose(sample(0))) == []
    assert list(assembler.add_pose(sample(REORDER_NS))) == []
    assert stamps(list(assembler.add_pose(sample(REORDER_NS + 1)))) == [0]
    assert stamps(list(assembler.flush())) == [REORDER_NS, REORDER_NS + 1]


def test_the_first_of_two_samples_of_an_edge_counts() -> None:
    assembler = FrameAssembler(lambda _: None)
    for status in (1, 2):
        assert list(assembler.add_pose(sample(0, status=status))) == []
    ((one,),) = (frame.poses for frame in assembler.flush())
    assert one.status is TrackingStatus.INVALID


def good(x_mm: float) -> TrackedTransform:
    pose = Transform("a", "b", np.eye(3), [x_mm, 0.0, 0.0])
    return TrackedTransform(pose, Stamp(0), TrackingStatus.OK)


def together(*samples: TrackedTransform) -> tuple[TrackedTransform, list[str]]:
    notes: list[str] = []
    assembler = FrameAssembler(notes.append)
    for each in samples:
        assert list(assembler.add_pose(each)) == []
    ((one,),) = (frame.poses for frame in assembler.flush())
    return one, notes


def test_repeated_pose_is_one_sample() -> None:
    one, notes = together(good(1.0), good(1.0))
    assert one.transform is not None
    assert notes == []


def test_two_poses_with_one_stamp_become_invalid_with_a_note() -> None:
    one, notes = together(good(1.0), good(2.0), good(2.0))
    assert one.status is TrackingStatus.INVALID
    assert len(notes) == 1 and "two poses" in notes[0]


def test_lost_sample_overrides_a_valid_one_in_either_order() -> None:
    assert together(good(1.0), sample(0))[0].status is TrackingStatus.INVALID
    assert together(sample(0), good(1.0))[0].status is TrackingStatus.INVALID


def test_joints_go_with_the_first_frame_not_older_and_the_rest_with_the_last() -> None:
    assembler = FrameAssembler(lambda _: None)
    for ns in (30, 10, 25, 20, 5):
        assembler.add_joints(joints(ns))
    for ns in (10, 20):
        assert list(assembler.add_pose(sample(ns))) == []
    assert [[j.stamp.ns for j in f.joints] for f in assembler.flush()] == [[5, 10], [20, 25, 30]]


def test_clock_jump_back_flushes_the_buffer() -> None:
    assembler = FrameAssembler(lambda _: None)
    far = 10 * REORDER_NS
    assert list(assembler.add_pose(sample(far))) == []
    assert stamps(list(assembler.add_pose(sample(0)))) == [far]
    assert stamps(list(assembler.flush())) == [0]


def test_joints_without_frames_do_not_accumulate() -> None:
    notes: list[str] = []
    assembler = FrameAssembler(notes.append)
    one = joints(10**15)
    for _ in range(250_000):
        assembler.add_joints(one)
    assert list(assembler.add_pose(sample(0))) == []
    (frame,) = assembler.flush()
    assert len(frame.joints) <= 100_000
    assert len(notes) == 1 and "offset_robot_to_tracker_ms" in notes[0]
