"""Recordings and bags: what another reader finds, full disks, and what is refused."""

import errno
import hashlib
import math
import os
import re
import resource
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_types_from_msg
from scipy.spatial.transform import Rotation

from app.case import BagTopic, BagWriter, TrackingFrame, write_recording
from app.case.bag_writer import CompleteFile
from app.case.frames_recorder import frames_as_read
from app.case.messages.ros_messages import TRACKED_TRANSFORM, TRACKED_TRANSFORM_DEFINITION
from app.case.readers.rosbag2.bag import read_bag
from app.geometry import InputError, Stamp, TrackingStatus

OFFSET_NS = 37_000_000


def ns(stamp: object) -> int:
    return stamp.sec * 10**9 + stamp.nanosec  # type: ignore[attr-defined]


def test_another_reader_finds_what_was_written(tmp_path, frames):
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


def test_the_same_frames_give_the_same_bytes(tmp_path, frames):
    digests = set()
    for name in ("one", "two"):
        write_recording(tmp_path / name, frames(100))
        digests.add(hashlib.sha256((tmp_path / name).read_bytes()).hexdigest())
    assert len(digests) == 1


def test_failed_recording_leaves_no_file(tmp_path, frames):
    def failing() -> Iterator[TrackingFrame]:
        yield from frames(5)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_recording(tmp_path / "x.mcap", failing())
    assert list(tmp_path.iterdir()) == []


def test_existing_files_are_not_overwritten(tmp_path, frames):
    path = tmp_path / "x.mcap"
    path.write_text("mine")
    with pytest.raises(InputError, match="already exists; refusing to overwrite"):
        write_recording(path, frames(5))
    assert path.read_text() == "mine"
    with pytest.raises(InputError, match="cannot be written"):
        write_recording(tmp_path / "no" / "x.mcap", frames(5))


@pytest.mark.parametrize("bad_ns", [-1, 2**31 * 10**9, 2**61])
def test_stamps_that_do_not_fit_are_refused(tmp_path, frames, bad_ns):
    (frame,) = frames(1)
    sample = type(frame.poses[0]).lost("a", "b", Stamp(bad_ns), TrackingStatus.MISSING)
    with pytest.raises(InputError, match=r"stamp (to record )?is -?\d+ ns; expected"):
        write_recording(tmp_path / "x.mcap", [TrackingFrame(Stamp(bad_ns), (sample,))])


def test_the_definition_is_that_of_the_interface_package(project_root):
    path = project_root / "interfaces/marginguard_msgs/msg/TrackedTransform.msg"
    own = get_types_from_msg(TRACKED_TRANSFORM_DEFINITION, TRACKED_TRANSFORM)
    installed = get_types_from_msg(path.read_text(), TRACKED_TRANSFORM)
    assert own == installed
    constants = dict(re.findall(r"^uint8 (\w+)\s*=\s*(\d+)", path.read_text(), re.MULTILINE))
    assert constants == {status.name: str(int(status)) for status in TrackingStatus}


WORDS = BagTopic("/words", "std_msgs/msg/String", "string data", type_hash="RIHS01_00")
NS = 1_700_000_000_000_000_000


def write_word(bag, number, size=16):
    # Incompressible bytes.
    data = b"".join(hash((number, at)).to_bytes(8, "little", signed=True) for at in range(size))
    bag.write("/words", data, received_ns=NS + number, published_ns=NS + number - 1)


def test_a_bag_is_read_by_rosbags_and_by_mcap(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    bag.add_topic(WORDS)
    for number in range(10):
        write_word(bag, number)
    bag.close()
    bag.close()
    with Reader(tmp_path / "bag") as read:
        assert read.message_count == 10
        assert read.start_time == NS
        assert [received for _, received, _ in read.messages()] == [NS + n for n in range(10)]
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        messages = [message for _, _, message in make_reader(file).iter_messages()]
    assert [message.sequence for message in messages] == list(range(10))
    assert [message.publish_time for message in messages] == [NS + n - 1 for n in range(10)]
    metadata = (tmp_path / "bag" / "metadata.yaml").read_text()
    assert "&id" not in metadata
    assert yaml.safe_load(metadata)["rosbag2_bagfile_information"]["message_count"] == 10


def test_flushed_messages_are_readable_without_close(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    bag.add_topic(WORDS)
    for number in range(5):
        write_word(bag, number)
    bag.flush()
    write_word(bag, 5)
    notes: list[str] = []
    found = list(read_bag(tmp_path / "bag" / "bag_0.mcap", notes.append))
    assert len(found) == 5
    bag.close()


def test_existing_bag_is_not_overwritten(tmp_path):
    (tmp_path / "bag").mkdir()
    with pytest.raises(InputError, match="already exists; refusing to overwrite"):
        BagWriter(tmp_path / "bag")


@pytest.fixture
def small_disk() -> Iterator[int]:
    """Limit the size of files that this process writes; gives the limit in bytes."""
    limit = 200_000
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    yield limit
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


def test_full_disk_is_reported_in_one_line_and_keeps_flushed_messages(tmp_path, small_disk):
    bag = BagWriter(tmp_path / "bag")
    bag.add_topic(WORDS)
    flushed = 0
    with pytest.raises(InputError, match=r"cannot be written: .*; up to .* messages") as refusal:
        for number in range(100_000):
            write_word(bag, number, size=200)
            if number % 10 == 9:
                bag.flush()
                flushed = number + 1
    assert "\n" not in str(refusal.value)
    with pytest.raises(InputError, match="cannot be written: an earlier write failed"):
        write_word(bag, 0)
    bag.close()
    found = list(read_bag(tmp_path / "bag" / "bag_0.mcap", lambda note: None))
    assert flushed > 50
    assert len(found) >= flushed
    assert not (tmp_path / "bag" / "metadata.yaml").exists()


PLAIN_WORDS = BagTopic("/words", "std_msgs/msg/String", "string data")


def read(path: Path) -> tuple[list[bytes], list[bytes], list[str]]:
    """Data of the messages by the MCAP library and by our reader, and the notes of ours."""
    with path.open("rb") as file:
        theirs = [message.data for _, _, message in make_reader(file).iter_messages()]
    notes: list[str] = []
    return theirs, [message.data for message in read_bag(path, notes.append)], notes


def test_file_is_complete_after_each_flush(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    path = tmp_path / "bag" / "bag_0.mcap"
    assert read(path)[:2] == ([], [])
    bag.add_topic(PLAIN_WORDS)
    expected = []
    for number in range(5):
        expected.append(b"%d" % number)
        bag.write("/words", expected[-1], received_ns=number, published_ns=number)
        bag.flush()
        theirs, ours, (note,) = read(path)
        assert theirs == ours == expected
        assert "has no index, as after a crash" in note and "marginguard convert recover" in note
    bag.close()
    assert read(path) == (expected, expected, [])


def test_failed_write_leaves_the_file_as_it_was(tmp_path, monkeypatch):
    file = CompleteFile(tmp_path / "x")
    file.write(b"first")
    file.flush()
    before = (tmp_path / "x").read_bytes()
    real = os.pwrite
    full = iter([True, True, False])

    def pwrite(descriptor: int, data: bytes, at: int) -> int:
        """A disk with room for three more bytes, at first."""
        if not next(full):
            monkeypatch.setattr(os, "pwrite", real)
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(descriptor, data[:3], at)

    monkeypatch.setattr(os, "pwrite", pwrite)
    file.write(b"second" * 100)
    with pytest.raises(OSError, match="No space left"):
        file.flush()
    file.close()
    assert (tmp_path / "x").read_bytes() == before


def test_frames_without_poses_or_with_falling_stamps_are_refused(frames):
    written = list(frames(4))
    with pytest.raises(InputError, match="has 0 poses; expected poses"):
        frames_as_read([written[0], replace(written[1], poses=())])
    with pytest.raises(InputError, match="stamps that rise"):
        frames_as_read(written[::-1])
    assert frames_as_read([]) == ()
