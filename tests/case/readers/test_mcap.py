import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter

from app.case import Activation, SideTopics, TrackingFrame, read_mcap, write_recording
from app.case.messages.ros_messages import BOOL, TRACKED_TRANSFORM, ros_types
from app.geometry import InputError, Stamp, TrackedTransform, TrackingStatus, Transform
from tests.oracles.ros_objects import joint_state_message, tf_message, tracked_transform_message
from tests.refusals import refused

OFFSET_NS = 37_000_000


def read(path: Path, **given: Any) -> tuple[list[TrackingFrame], list[str]]:
    notes: list[str] = []
    side = SideTopics("/joint_states", OFFSET_NS)
    return list(read_mcap(path, notes.append, replace(side, **given))), notes


def pose(ns: int, source: str = "cautery", x_mm: float = 0.0) -> TrackedTransform:
    transform = Transform("tracker", source, np.eye(3), np.array([x_mm, 0.0, 0.0]))
    return TrackedTransform(transform, Stamp(ns), TrackingStatus.OK)


def write_messages(path, messages, definitions=None, **options):
    """Write ROS messages (topic, type, message or CDR bytes) in this order to an MCAP file.

    ``definitions``: schemas by topic that replace those of the types.
    """
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile="ros2", library="a test")
        channels: dict[str, int] = {}
        for index, (topic, kind, message) in enumerate(messages):
            if topic not in channels:
                own, _ = ros_types().generate_msgdef(kind, ros_version=2)
                definition = (definitions or {}).get(topic, own)
                schema = writer.register_schema(kind, "ros2msg", definition.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = (
                message if isinstance(message, bytes) else ros_types().serialize_cdr(message, kind)
            )
            writer.add_message(channels[topic], index, bytes(data), index)
        writer.finish()


@pytest.fixture
def recorded(tmp_path):
    """Write messages, and read the frames and notes of their recording."""

    def made(messages, definitions=None, **options):
        write_messages(tmp_path / "x.mcap", messages, definitions, **options)
        return read(tmp_path / "x.mcap")

    return made


def tracked(sample: TrackedTransform) -> tuple[str, str, Any]:
    return "/tracked_transforms", TRACKED_TRANSFORM, tracked_transform_message(sample)


def tf(*samples: TrackedTransform) -> tuple[str, str, Any]:
    return "/tf", "tf2_msgs/msg/TFMessage", tf_message(samples)


def test_written_values_are_read_back(tmp_path, frames, same_frames):
    path = tmp_path / "x.mcap"
    write_recording(path, frames(60), robot_to_tracker_offset_ns=OFFSET_NS)
    found, notes = read(path)
    assert notes == []
    same_frames(frames(60), found)


def test_joints_are_read_from_the_topic_of_the_manifest(tmp_path, frames):
    path = tmp_path / "x.mcap"
    write_recording(path, frames(9), joint_states_topic="/arm/joint_states")
    assert sum(len(f.joints) for f in read(path, topic="/arm/joint_states")[0]) == 36
    assert not any(f.joints for f in read(path, topic=None)[0])


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.NONE},
        {"use_chunking": False},
        {"chunk_size": 200},
    ],
)
def test_messages_are_read_with_any_chunking_and_compression(recorded, options):
    samples = [pose(10**9 + i * 10**7, x_mm=float(i)) for i in range(30)]
    frames, notes = recorded([tracked(s) for s in samples], **options)
    assert ([f.stamp for f in frames], notes) == ([s.stamp for s in samples], [])


def write_bag(folder: Path, count: int, plugin: StoragePlugin) -> Path:
    """Write a rosbag2 folder with rosbags; returns its only data file."""
    with BagWriter(folder, version=8, storage_plugin=plugin) as bag:
        topic = bag.add_connection("/tracked_transforms", TRACKED_TRANSFORM, typestore=ros_types())
        for index in range(count):
            _, kind, message = tracked(pose(10**9 + index))
            bag.write(topic, index, ros_types().serialize_cdr(message, kind))
    (path,) = (each for each in folder.iterdir() if each.suffix in (".db3", ".mcap"))
    return path


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_rosbag2_folder_is_read(tmp_path, plugin):
    write_bag(tmp_path / "bag", 10, plugin)
    frames, _ = read(tmp_path / "bag")
    assert [frame.stamp.ns for frame in frames] == [10**9 + index for index in range(10)]


def test_a_damaged_database_is_refused_in_one_line(tmp_path):
    database = write_bag(tmp_path / "bag", 200, StoragePlugin.SQLITE3)
    whole = database.read_bytes()
    no_text = whole.replace(b"/tracked_transforms", b"\xa3tracked_transforms")
    for damaged in (no_text, b"", whole[:2000], whole[:-4096], b"\xff" * 20_000):
        database.write_bytes(damaged)
        with refused("is not a readable rosbag2 recording"):
            read(tmp_path / "bag")


def test_late_messages_are_sorted(recorded):
    order = [0, 3, 1, 2, 6, 5, 4, 9, 8, 7]
    messages = [tracked(pose(10**9 + i * 10**8)) for i in order]
    messages.insert(4, tracked(pose(10**9, "needle")))
    frames, _ = recorded(messages)
    assert [frame.stamp.ns for frame in frames] == [10**9 + i * 10**8 for i in range(10)]
    assert [p.source for p in frames[0].poses] == ["cautery", "needle"]


@settings(max_examples=25)
@given(delays_ms=st.lists(st.integers(0, 450), min_size=1, max_size=40))
def test_any_delay_within_the_buffer_is_sorted(tmp_path_factory, delays_ms):
    path = tmp_path_factory.mktemp("late") / "x.mcap"
    stamps = [10**9 + i * 20_000_000 for i in range(len(delays_ms))]
    arrivals = sorted(range(len(stamps)), key=lambda i: stamps[i] + delays_ms[i] * 10**6)
    write_messages(path, [tracked(pose(stamps[i])) for i in arrivals])
    assert [frame.stamp.ns for frame in read(path)[0]] == stamps


def test_a_clock_that_jumped_back_stays_visible(recorded):
    stamps = [10 * 10**9 + i * 10**8 for i in range(9)] + [2 * 10**9 + i * 10**8 for i in range(9)]
    frames, _ = recorded([tracked(pose(ns)) for ns in stamps])
    assert [frame.stamp.ns for frame in frames] == stamps


def test_untracked_edges_are_read_from_tf(recorded):
    lost = TrackedTransform.lost("tracker", "cautery", Stamp(10**9 + 1), TrackingStatus.INVALID)
    messages = [
        tracked(pose(10**9, x_mm=1.0)),
        tf(pose(10**9, x_mm=2.0), pose(10**9, "probe")),
        tracked(lost),
        tf(pose(10**9 + 1, x_mm=2.0), pose(10**9 + 1, "probe")),
        ("/tf_static", "tf2_msgs/msg/TFMessage", tf_message([pose(10**9, "static")])),
    ]
    frames, _ = recorded(messages)
    assert [[(p.source, p.status.name) for p in f.poses] for f in frames] == [
        [("cautery", "OK"), ("probe", "OK")],
        [("cautery", "INVALID"), ("probe", "OK")],
    ]
    first = frames[0].poses[0].transform
    assert first is not None and first.translation_mm[0] == pytest.approx(1.0)


def test_tracked_edges_are_not_read_from_tf_and_a_bag_with_tf_only_is_read(recorded):
    messages = [tracked(pose(10**9)), tf(pose(10**9 + 5)), tracked(pose(10**9 + 10))]
    assert [frame.stamp.ns for frame in recorded(messages)[0]] == [10**9, 10**9 + 10]
    assert len(recorded([tf(pose(10**9 + i)) for i in range(5)])[0]) == 5


@pytest.mark.parametrize(
    ("edit", "status"),
    [
        (lambda m: setattr(m.transform.translation, "x", np.nan), TrackingStatus.NOT_FINITE),
        (lambda m: setattr(m.transform.rotation, "w", np.inf), TrackingStatus.NOT_FINITE),
        (lambda m: setattr(m.transform.rotation, "w", 0.5), TrackingStatus.NOT_RIGID),
        (lambda m: setattr(m.transform.rotation, "w", 0.0), TrackingStatus.NOT_RIGID),
        (lambda m: setattr(m, "status", 250), TrackingStatus.INVALID),
        (lambda m: setattr(m, "status", 3), TrackingStatus.OUT_OF_VIEW),
    ],
)
def test_invalid_poses_become_a_status(recorded, edit, status):
    topic, kind, message = tracked(pose(10**9))
    edit(message)
    ((frame,), _) = recorded([(topic, kind, message)])
    assert [(p.status, p.transform) for p in frame.poses] == [(status, None)]


def test_unreadable_messages_are_skipped_with_a_note(recorded, frames):
    topic, kind, nameless = tracked(pose(10**9))
    nameless.child_frame_id = "not a frame"
    (frame,) = frames(1)
    joints = joint_state_message(frame.joints[0], 5)
    joints.position = np.zeros(7)
    bad = [(topic, kind, each) for each in (nameless, b"\x00\x01\x00\x00\x01\x02", b"")]
    last = ("/joint_states", "sensor_msgs/msg/JointState", joints)
    frames_read, notes = recorded([*bad, tracked(pose(10**9)), last])
    assert len(frames_read) == 1
    assert any("/joint_states" in note and "2 names" in note for note in notes)
    assert "3 messages on /tracked_transforms were skipped in all" in notes


def test_a_topic_of_another_type_and_a_recording_without_poses_are_refused(recorded):
    other = ("/tracked_transforms", "tf2_msgs/msg/TFMessage", tf_message([pose(10**9)]))
    with refused("carries tf2_msgs/msg/TFMessage; expected marginguard_msgs"):
        recorded([other])
    with pytest.raises(InputError, match="holds no readable sample"):
        recorded([])


@pytest.mark.parametrize("definition", ["no definition", "tf2_msgs/TFMessage[] transforms\n"])
def test_topic_with_unusable_definition_is_skipped(recorded, definition):
    messages = [tracked(pose(10**9)), tf(pose(10**9, "pointer")), tf(pose(10**9, "pointer"))]
    (frame,), notes = recorded(messages, {"/tf": definition})
    assert [sample.source for sample in frame.poses] == ["cautery"]
    assert "a message on /tf cannot be used and is skipped: the definition of tf2_msgs" in notes[0]
    assert "\n" not in notes[0]
    assert notes[1:] == ["2 messages on /tf were skipped in all"]


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"RIFF" * 100])
def test_file_that_is_not_mcap_is_refused(tmp_path, content):
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(InputError, match="is not an MCAP file"):
        read(tmp_path / "x.mcap")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[int], int]:
    """A recording of many chunks, its stamps in order, and where its first chunk ends."""
    path = tmp_path_factory.mktemp("whole") / "x.mcap"
    stamps = [10**9 + i * 20_000_000 for i in range(200)]
    write_messages(path, [tracked(pose(ns)) for ns in stamps], chunk_size=4000)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and len(summary.chunk_indexes) > 5
    first = summary.chunk_indexes[0]
    return path.read_bytes(), stamps, first.chunk_start_offset + first.chunk_length


@settings(max_examples=40)
@given(data=st.data())
def test_intact_part_of_a_cut_file_is_used_with_a_note(tmp_path_factory, recording, data):
    content, stamps, first_chunk_end = recording
    cut = data.draw(st.integers(8, len(content)))
    path = tmp_path_factory.mktemp("cut") / "x.mcap"
    path.write_bytes(content[:cut])
    notes, found = [], []
    try:
        frames = read_mcap(path, notes.append, SideTopics())
        found.extend(frame.stamp.ns for frame in frames)
    except InputError as error:
        assert "holds no readable sample" in str(error)
        assert cut < first_chunk_end
    assert found == stamps[: len(found)]
    assert bool(found) == (cut >= first_chunk_end)
    # Without a note only the index is cut and the data are complete.
    assert found == stamps or any("is cut or damaged at byte" in note for note in notes)


@settings(max_examples=50)
@given(data=st.data())
def test_damaged_bytes_neither_crash_nor_create_poses(tmp_path_factory, recording, data):
    content, stamps, _ = recording
    damaged = bytearray(content)
    for _ in range(data.draw(st.integers(1, 4))):
        position = data.draw(st.integers(8, len(content) - 1))
        damaged[position] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.mktemp("damaged") / "x.mcap"
    path.write_bytes(damaged)
    try:
        frames, _ = read(path)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert {frame.stamp.ns for frame in frames} <= set(stamps)


def test_chunk_with_wrong_crc_is_skipped(tmp_path):
    path = tmp_path / "x.mcap"
    messages = [tracked(pose(10**9 + i * 10**7, x_mm=1234.5 + i)) for i in range(20)]
    write_messages(path, messages, compression=CompressionType.NONE, chunk_size=1)
    content = path.read_bytes()
    metres = struct.pack("<d", 1.2395)  # of the sixth message
    assert content.count(metres) == 1
    path.write_bytes(content.replace(metres, struct.pack("<d", 1.2495)))
    frames, notes = read(path)
    assert len(frames) == 19
    assert len(notes) == 1 and "is damaged and skipped (crc" in notes[0]


@pytest.mark.parametrize("kind", ["zstd", "lz4"])
def test_chunk_that_unpacks_beyond_its_size_is_skipped(tmp_path, kind):
    bomb = b"\0" * 50_000_000
    packed = zstandard.compress(bomb) if kind == "zstd" else lz4.frame.compress(bomb)
    name = kind.encode()
    chunk = struct.pack("<QQQI", 0, 0, 1000, 0) + struct.pack("<I", len(name)) + name
    chunk += struct.pack("<Q", len(packed)) + packed
    path = tmp_path / "x.mcap"
    write_messages(path, [tracked(pose(10**9))])
    whole = path.read_bytes()
    header_end = 8 + 9 + struct.unpack_from("<Q", whole, 9)[0]
    record = struct.pack("<BQ", 6, len(chunk)) + chunk
    path.write_bytes(whole[:header_end] + record + whole[header_end:])
    frames, notes = read(path)
    assert len(frames) == 1
    assert len(notes) == 1 and "unpacks to 1001 bytes or more; expected 1000" in notes[0]


def test_record_length_beyond_the_file_is_not_trusted(tmp_path):
    path = tmp_path / "x.mcap"
    write_messages(path, [tracked(pose(10**9))])
    path.write_bytes(path.read_bytes()[:-60] + b"\x06" + b"\xff" * 8)
    assert len(read(path)[0]) == 1


def test_frames_have_the_state_of_the_cautery_at_their_receipt(tmp_path):
    """Messages are received 1 ns apart; what was said is unknown after 4 ns."""

    def said(on: bool) -> tuple[str, str, Any]:
        return "/cautery", BOOL, ros_types().types[BOOL](data=on)

    def tip(number: int) -> tuple[str, str, Any]:
        return tracked(pose(10**9 + number * 10**7, x_mm=float(number)))

    messages = [tip(0), said(True), tip(1), said(False), tip(2), *(tip(n) for n in range(3, 8))]
    path = tmp_path / "x.mcap"
    write_messages(path, messages)
    frames, notes = read(path, activation="/cautery", activation_stale_after_ns=4)
    unknown, on, off = Activation.UNKNOWN, Activation.ON, Activation.OFF
    assert [each.activation for each in frames] == [
        unknown,
        on,
        off,
        off,
        off,
        off,
        unknown,
        unknown,
    ]
    assert notes == []
    assert {each.activation for each in read(path)[0]} == {None}
