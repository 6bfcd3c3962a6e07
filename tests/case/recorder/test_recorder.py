import hashlib
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_types_from_msg
from scipy.spatial.transform import Rotation

from app.case import TrackingFrame, write_recording
from app.case.messages.ros_messages import TRACKED_TRANSFORM, TRACKED_TRANSFORM_DEFINITION
from app.geometry import InputError, Stamp, TrackingStatus

Frames = Callable[..., Iterator[TrackingFrame]]
OFFSET_NS = 37_000_000


def ns(stamp: object) -> int:
    return stamp.sec * 10**9 + stamp.nanosec  # type: ignore[attr-defined]


def test_another_reader_finds_what_was_written(tmp_path: Path, frames: Frames) -> None:
    path = tmp_path / "x.mcap"
    written = list(frames(40))
    write_recording(path, written, robot_to_tracker_offset_ns=OFFSET_NS)
    poses = [sample for frame in written for sample in frame.poses]
    valid = [sample for sample in poses if sample.status is TrackingStatus.OK]
    joints = [sample for frame in written for sample in frame.joints]
    with AnyReader([path]) as bag:
        found: dict[str, list] = {}
        logged = []
        for connection, time, data in bag.messages():
            logged.append(time)
            found.setdefault(connection.topic, []).append(bag.deserialize(data, connection.msgtype))
    assert logged == sorted(logged)
    assert len(valid) < len(poses) == len(found["/tracked_transforms"])
    for message, sample in zip(found["/tracked_transforms"], poses, strict=True):
        assert ns(message.header.stamp) == sample.stamp.ns
        assert (message.header.frame_id, message.child_frame_id) == (sample.target, sample.source)
        assert message.status == sample.status
        assert math.isnan(message.transform.translation.x) == (sample.transform is None)
        assert math.isnan(message.transform.rotation.w) == (sample.transform is None)
    transforms = [t for message in found["/tf"] for t in message.transforms]
    for message, sample in zip(transforms, valid, strict=True):
        assert sample.transform is not None
        position, quaternion = message.transform.translation, message.transform.rotation
        position_m = np.array([position.x, position.y, position.z])
        np.testing.assert_allclose(position_m * 1e3, sample.transform.translation_mm, atol=1e-10)
        rotation = Rotation.from_quat(
            [quaternion.x, quaternion.y, quaternion.z, quaternion.w]
        ).as_matrix()
        np.testing.assert_allclose(rotation, sample.transform.rotation, atol=1e-12)
    for message, joint in zip(found["/joint_states"], joints, strict=True):
        assert ns(message.header.stamp) == joint.stamp.ns - OFFSET_NS
        assert message.name == list(joint.names)
        np.testing.assert_array_equal(message.position, joint.positions)


def test_the_same_frames_give_the_same_bytes(tmp_path: Path, frames: Frames) -> None:
    digests = set()
    for name in ("one", "two"):
        write_recording(tmp_path / name, frames(100))
        digests.add(hashlib.sha256((tmp_path / name).read_bytes()).hexdigest())
    assert len(digests) == 1


def test_failed_recording_leaves_no_file(tmp_path: Path, frames: Frames) -> None:
    def failing() -> Iterator[TrackingFrame]:
        yield from frames(5)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_recording(tmp_path / "x.mcap", failing())
    assert list(tmp_path.iterdir()) == []


def test_existing_files_are_not_overwritten(tmp_path: Path, frames: Frames) -> None:
    path = tmp_path / "x.mcap"
    path.write_text("mine")
    with pytest.raises(InputError, match="already exists; refusing to overwrite"):
        write_recording(path, frames(5))
    assert path.read_text() == "mine"
    with pytest.raises(InputError, match="cannot be written"):
        write_recording(tmp_path / "no" / "x.mcap", frames(5))


@pytest.mark.parametrize("bad_ns", [-1, 2**31 * 10**9, 2**63])
def test_stamps_that_do_not_fit_are_refused(tmp_path: Path, frames: Frames, bad_ns: int) -> None:
    (frame,) = frames(1)
    sample = type(frame.poses[0]).lost("a", "b", Stamp(bad_ns), TrackingStatus.MISSING)
    with pytest.raises(InputError, match=r"stamp (to record )?is -?\d+ ns; expected"):
        write_recording(tmp_path / "x.mcap", [TrackingFrame(Stamp(bad_ns), (sample,))])


def test_the_definition_is_that_of_the_interface_package(project_root: Path) -> None:
    path = project_root / "interfaces/marginguard_msgs/msg/TrackedTransform.msg"
    own = get_types_from_msg(TRACKED_TRANSFORM_DEFINITION, TRACKED_TRANSFORM)
    installed = get_types_from_msg(path.read_text(), TRACKED_TRANSFORM)
    assert own == installed
    constants = dict(re.findall(r"^uint8 (\w+)\s*=\s*(\d+)", path.read_text(), re.MULTILINE))
    assert constants == {status.name: str(int(status)) for status in TrackingStatus}
