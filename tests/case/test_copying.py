import hashlib
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from app.case import convert_case, open_case, recover_recording
from app.case.messages.ros_messages import ros_types
from app.geometry import InputError
from tests.case.conftest import add_robot, write_manifest
from tests.cli.command import refused, run

pytestmark = pytest.mark.slow

EXTRA = ("/camera", "our_msgs/msg/Picture", b"uint8[] pixels")


def content(path: Path) -> tuple[Counter[tuple[str, ...]], list[tuple[Any, ...]]]:
    """Number of messages by topic, type, definition and metadata; and all messages in order."""
    topics: Counter[tuple[str, ...]] = Counter()
    messages = []
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            own = (schema.name, schema.encoding, schema.data.decode()) if schema else ("",) * 3
            key = (channel.topic, *own)
            topics[*key, channel.message_encoding, json.dumps(channel.metadata)] += 1
            times = message.log_time, message.publish_time
            messages.append((channel.topic, *times, message.sequence, message.data))
    return topics, messages


def with_extra_topics(source: Path, target: Path) -> None:
    """Copy ``source`` and put between its messages those of topics that no reader here knows."""
    with source.open("rb") as file, target.open("xb") as out:
        writer = Writer(out, chunk_size=3000)
        writer.start(profile="ros2", library="another")
        name, kind, definition = EXTRA
        picture = writer.register_schema(kind, "ros2msg", definition)
        qos = {"offered_qos_profiles": "- reliability: 1"}
        extra = writer.register_channel(name, "cdr", picture, qos)
        plain = writer.register_channel("/notes", "json", 0)
        known: dict[str, int] = {}
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if channel.topic not in known:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                known[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
            ns = message.log_time
            writer.add_message(known[channel.topic], ns, message.data, ns + 1, message.sequence)
            writer.add_message(extra, ns, b"\0\1\0\0" + bytes(50), ns + 2, 7)
            writer.add_message(plain, ns, b'{"a": 1}', ns + 3, 8)
        writer.finish()


@pytest.fixture
def case(manifest: dict[str, Any], write_case: Callable[..., Path]) -> Path:
    """A case whose recording has topics and encodings that a replay does not read."""
    folder = write_case(manifest)
    (folder / "tracking.mcap").rename(folder / "plain.mcap")
    with_extra_topics(folder / "plain.mcap", folder / "tracking.mcap")
    return folder


def test_conversion_keeps_all_messages_of_all_topics(case, tmp_path, same_frames):
    opened = open_case(case)
    assert convert_case(opened, tmp_path / "new") == ()
    before, after = (content(folder / "tracking.mcap") for folder in (case, tmp_path / "new"))
    assert {key[0] for key in before[0]} >= {"/camera", "/notes", "/tracked_transforms", "/tf"}
    assert before == after
    converted = open_case(tmp_path / "new")
    same_frames(opened.frames(), converted.frames())


def test_database_is_converted_with_all_topics(manifest, write_case, tmp_path):
    folder = write_case(manifest)
    manifest["recording"] = {"path": "bag"}
    with RosbagsWriter(folder / "bag", version=8, storage_plugin=StoragePlugin.SQLITE3) as bag:
        known = {}
        with (folder / "tracking.mcap").open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages():
                assert schema is not None
                topic = channel.topic
                if topic not in known:
                    known[topic] = bag.add_connection(topic, schema.name, typestore=ros_types())
                bag.write(known[topic], message.log_time, message.data)
    (folder / "case.yaml").write_text(json.dumps(manifest))
    original = content(folder / "tracking.mcap")[1]
    convert_case(open_case(folder), tmp_path / "new")
    topics, messages = content(tmp_path / "new" / "tracking.mcap")
    found, expected = (sorted((a, b, e) for a, b, _, _, e in each) for each in (messages, original))
    assert found == expected
    assert all(len(definition) > 20 for _, _, _, definition, _, _ in topics)


def test_unreadable_and_empty_recordings_are_neither_converted_nor_recovered(case, tmp_path):
    opened = open_case(case)
    path = case / "tracking.mcap"
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(InputError, match="holds no readable sample"):
        convert_case(opened, tmp_path / "new")
    with (tmp_path / "x.mcap").open("xb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    with pytest.raises(InputError, match="holds no intact message"):
        recover_recording(tmp_path / "x.mcap", tmp_path / "new.mcap")
    (tmp_path / "x.igs.mha").touch()
    with pytest.raises(InputError, match="has no messages to recover"):
        recover_recording(tmp_path / "x.igs.mha", tmp_path / "new.mcap")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["case", "x.igs.mha", "x.mcap"]


def test_cut_recording_is_recovered_and_not_changed(case, tmp_path):
    source, target = case / "tracking.mcap", tmp_path / "new.mcap"
    whole = content(source)[1]
    source.write_bytes(source.read_bytes()[: source.stat().st_size // 2])
    digest = hashlib.sha256(source.read_bytes()).hexdigest()
    printed = run("convert", "recover", source, target).out
    assert "note: tracking.mcap is cut or damaged at byte" in printed
    found = content(target)[1]
    assert 0 < len(found) < len(whole)
    assert set(found) <= set(whole)
    assert f"{len(found)} messages of 6 topics" in printed
    assert hashlib.sha256(source.read_bytes()).hexdigest() == digest
    with target.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == len(found)


@pytest.mark.parametrize(
    ("source", "target", "problem"),
    [
        ("tracking.mcap", "plain.mcap", "already exists; refusing to overwrite it"),
        ("tool.stl", "new.mcap", "is not a recording"),
        ("tracking.mcap", "new.db3", "unknown ending; expected .mcap"),
        ("empty.mcap", "new.mcap", "is not an MCAP file"),
    ],
)
def test_recover_refuses_and_writes_nothing(case, source, target, problem):
    (case / "empty.mcap").touch()
    before = sorted(path.name for path in case.iterdir())
    assert problem in refused("convert", "recover", case / source, case / target)
    assert sorted(path.name for path in case.iterdir()) == before


@pytest.fixture
def real_case(manifest, write_case, real_recording) -> Path:
    name = "EightLandmarkPointsTrackedForPhantomRegistration.igs.mha"
    manifest |= {"recording": {"path": name}, "expected": "expected.yaml"}
    manifest["tool"]["frame"] = "stylus"
    folder = write_case(manifest)
    (folder / "tracking.mcap").unlink()
    (folder / "expected.yaml").write_text("frames: 1000\n")
    (folder / name).write_bytes(real_recording(name).read_bytes())
    return folder


def test_real_recording_is_converted_unchanged(real_case, tmp_path, same_frames):
    case = open_case(real_case)
    assert convert_case(case, tmp_path / "converted") == ()
    converted = open_case(tmp_path / "converted")
    assert converted.manifest.recording.sha256 is not None
    assert converted.expected() is not None
    frames = list(converted.recorded_frames())
    assert len(frames) == 1000
    same_frames(case.recorded_frames(), frames)
    assert not (tmp_path / "converted" / case.recording_path.name).exists()


def test_joints_statuses_and_both_clocks_are_converted(manifest, write_case, tmp_path, same_frames):
    manifest["clock"] = {"offset_robot_to_tracker_ms": -12.5}
    add_robot(manifest, "arm/arm.urdf", joint_states="/joint_states")
    manifest["registration"] = {"method": "paired_points", "dwells": [{"start_s": 0, "end_s": 1}]}
    folder = write_case(manifest)
    (folder / "arm/meshes").mkdir(parents=True)
    (folder / "arm/arm.urdf").write_text("<robot/>")
    (folder / "arm/meshes/link.stl").write_text("x")
    case = open_case(folder)
    convert_case(case, tmp_path / "a" / "converted")
    converted = open_case(tmp_path / "a" / "converted")
    assert (converted.robot_urdf().parent / "meshes/link.stl").is_file()
    same_frames(case.frames(), converted.frames())
    before, after = (
        yaml.safe_load((c.folder / "case.yaml").read_text()) for c in (case, converted)
    )
    del before["recording"], after["recording"]
    assert before == after


def test_failed_conversion_leaves_no_folder_and_no_folder_is_overwritten(
    manifest, write_case, tmp_path
):
    manifest["recording"]["path"] = "x.igs.mha"
    folder = write_case(manifest)
    (folder / "x.igs.mha").write_text(
        "Seq_Frame0000_Timestamp = 1\nSeq_Frame0001_Timestamp = soon\nElementDataFile = LOCAL\n"
    )
    with pytest.raises(InputError, match="'soon'"):
        convert_case(open_case(folder), tmp_path / "converted")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["case"]
    manifest["recording"]["path"] = "tracking.mcap"
    (tmp_path / "there").mkdir()
    with pytest.raises(InputError, match="refusing to overwrite it"):
        convert_case(open_case(write_manifest(folder, manifest)), tmp_path / "there")
    assert list((tmp_path / "there").iterdir()) == []
