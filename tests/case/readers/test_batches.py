"""Decoding many messages together gives what decoding them one by one gives."""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from app.case import SideTopics, TrackingFrame, read_mcap
from app.case.frame_streams import JointSample
from app.case.messages.cdr_batch import joint_samples, tf_samples, tracked_samples
from app.case.messages.decoder import message_decoder
from app.case.messages.ros_messages import JOINT_STATE, TF_MESSAGE, TRACKED_TRANSFORM, ros_types
from app.case.readers.rosbag2 import bag_frames as reader
from app.geometry import InputError, Stamp, TrackedTransform, Transform
from tests.oracles.ros_objects import joint_state_message, tf_message, tracked_transform_message

pytestmark = pytest.mark.slow

OFFSET_NS = 37_000_000
TOPICS = {TRACKED_TRANSFORM: "/tracked_transforms", TF_MESSAGE: "/tf", JOINT_STATE: "/joint_states"}
Message = tuple[str, bytes]
"""Type and CDR bytes."""


def cdr(kind: str, message: Any, *, little_endian: bool = True) -> Message:
    return kind, bytes(ros_types().serialize_cdr(message, kind, little_endian=little_endian))


def a_pose(rng: Random, ns: int) -> TrackedTransform:
    turn = [rng.uniform(-1.0, 1.0) for _ in range(3)]
    place = [rng.uniform(-500.0, 500.0) for _ in range(3)]
    target, source = (
        rng.choice(["tracker", "reference"]),
        rng.choice(["needle", "cautery", "probe"]),
    )
    transform = Transform.from_rotation_vector(turn, place, target=target, source=source)
    return TrackedTransform.valid(transform, Stamp(ns))


SPECIAL = [np.nan, np.inf, -np.inf, 0.0, -0.0, 1e308, 1e-320, 2.0]
ODD = ["value", "status", "name", "bytes", "order", "time"]


def a_message(rng: Random, index: int, odd: str) -> Message:
    """A message of one of the three types, with what ``odd`` names."""
    ns = 10**10 + index * 10**7 - (10**9 if odd == "time" else 0)
    kind = rng.choice(list(TOPICS))
    message: Any
    if kind == TRACKED_TRANSFORM:
        message = tracked_transform_message(a_pose(rng, ns))
        if odd == "value":
            of = rng.choice([message.transform.translation, message.transform.rotation])
            setattr(of, rng.choice("xyz"), rng.choice(SPECIAL))
        elif odd == "status":
            message.status = rng.randrange(256)
        elif odd == "name":
            message.child_frame_id = rng.choice(["/needle", "no frame", "", "tool"])
    elif kind == TF_MESSAGE:
        message = tf_message([a_pose(rng, ns) for _ in range(rng.choice([0, 2, 2, 2]))])
        for stamped in message.transforms[-1:]:
            if odd == "value":
                stamped.transform.rotation.w = rng.choice(SPECIAL)
            elif odd == "name":
                stamped.child_frame_id = rng.choice(["/a", "b c"])
    else:
        count = rng.choice([2, 2, 2, 2, 0, 3]) if odd else 2
        names = tuple(f"joint_{number}" for number in range(count))
        message = joint_state_message(JointSample(names, (0.5 + index,) * count, Stamp(ns)), ns)
        if odd == "value" and count:
            message.position[0] = rng.choice(SPECIAL)
        elif odd == "status":
            message.position = np.zeros(rng.randrange(5))
        elif odd == "name" and count:
            message.name[-1] = rng.choice(["joint_0", "other_1"])
    kind, data = cdr(kind, message, little_endian=odd != "order")
    if odd == "bytes":
        changed = bytearray(data)
        for _ in range(rng.randint(1, 3)):
            changed[rng.randrange(len(data))] ^= rng.randint(1, 255)
        data = bytes(changed[: len(data) - rng.choice([0, 0, 3])])
    return kind, data


def recorded_messages(rng: Random) -> list[Message]:
    """Messages of all three types; a part of them has odd values, names, times or bytes."""
    share = rng.choice([0.02, 0.1, 0.3])
    odd = [rng.choice(ODD) if rng.random() < share else "" for _ in range(rng.randint(20, 80))]
    return [a_message(rng, index, each) for index, each in enumerate(odd)]


@dataclass
class Outcome:
    frames: list[str]
    notes: list[str]
    error: str


def shown(frame: TrackingFrame) -> str:
    """All values of a frame, numbers to the last bit."""
    poses = [
        (
            each.target, each.source, each.stamp, each.status.name,
            None if each.transform is None else each.transform.rotation.tobytes(),
            None if each.transform is None else each.transform.translation_mm.tobytes(),
            None if each.transform is None else (each.transform.target, each.transform.source),
        )
        for each in frame.poses
    ]  # fmt: skip
    joints = [(each.names, each.positions, each.stamp) for each in frame.joints]
    return repr((frame.stamp, poses, joints, frame.unfiltered_stamp))


def outcome(path: Path) -> Outcome:
    found = Outcome([], [], "")
    try:
        for frame in read_mcap(path, found.notes.append, SideTopics("/joint_states", OFFSET_NS)):
            found.frames.append(shown(frame))
    except InputError as error:
        found.error = str(error)
    return found


def write(path: Path, messages: list[Message]) -> None:
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=20_000)
        writer.start(profile="ros2", library="a test")
        channels = {}
        for kind, topic in TOPICS.items():
            definition, _ = ros_types().generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", definition.encode())
            channels[kind] = writer.register_channel(topic, "cdr", schema)
        for index, (kind, data) in enumerate(messages):
            writer.add_message(channels[kind], index, data, index)
        writer.finish()


def one_by_one(path: Path, monkeypatch: pytest.MonkeyPatch) -> Outcome:
    with monkeypatch.context() as patch:
        patch.setattr(reader, "_MIN_BATCH", 10**9)
        return outcome(path)


def test_a_recording_is_read_as_one_by_one(tmp_path, monkeypatch):
    batched = []
    real = reader.MessageDecoder.batch

    def counted(self: Any, messages: Any, decode: Any) -> list[Any]:
        found = real(self, messages, decode)
        batched.extend(sample for sample in found if sample is not None)
        return found

    monkeypatch.setattr(reader.MessageDecoder, "batch", counted)

    noted = 0
    for seed in range(40):
        rng = Random(seed)
        path = tmp_path / "x.mcap"
        write(path, recorded_messages(rng))
        content = bytearray(path.read_bytes())
        if rng.random() < 0.3:
            content[rng.randrange(8, len(content))] ^= 1
        path.write_bytes(content)
        expected = one_by_one(path, monkeypatch)
        assert outcome(path) == expected, f"seed {seed}"
        noted += bool(expected.notes)
    assert len(batched) > 500
    assert 10 < noted < 40


DECODED: dict[str, tuple[Callable[..., list[Any]], Callable[[Any], Any]]] = {
    TRACKED_TRANSFORM: (tracked_samples, lambda values: values.sample()),
    TF_MESSAGE: (tf_samples, lambda values: tuple(each.sample() for each in values)),
    JOINT_STATE: (
        lambda *given: joint_samples(*given, offset_ns=OFFSET_NS),
        lambda values: values.sample(offset_ns=OFFSET_NS),
    ),
}


def as_frame(sample: Any) -> str:
    poses = sample if isinstance(sample, tuple) else (sample,)
    if isinstance(sample, JointSample):
        return shown(TrackingFrame(Stamp(0), (), (sample,)))
    return shown(TrackingFrame(Stamp(0), poses))


def test_each_sample_of_a_batch_is_that_of_its_message():
    good = dict.fromkeys(DECODED, 0)
    for seed in range(40):
        messages = recorded_messages(Random(seed))
        for kind, (batch, sample_of) in DECODED.items():
            decoder = message_decoder(kind)
            by_length: dict[int, list[bytes]] = {}
            for other, data in messages:
                if other == kind:
                    by_length.setdefault(len(data), []).append(data)
            for alike in by_length.values():
                try:
                    decoder(alike[0])  # learns the layout
                except InputError:
                    continue
                for data, found in zip(alike, decoder.batch(alike, batch), strict=True):
                    if found is not None:
                        good[kind] += 1
                        assert as_frame(found) == as_frame(sample_of(decoder(data)))
    assert min(good.values()) > 200


def test_all_good_messages_of_a_known_layout_are_decoded_together():
    transform = Transform("tracker", "needle", np.eye(3), np.array([1.0, 2.0, 3.0]))
    poses = [TrackedTransform.valid(transform, Stamp(n)) for n in range(20)]
    joints = [JointSample(("a", "b"), (0.1, 0.2), Stamp(n)) for n in range(20)]
    for kind, messages in (
        (TRACKED_TRANSFORM, [tracked_transform_message(pose) for pose in poses]),
        (TF_MESSAGE, [tf_message([pose, pose]) for pose in poses]),
        (JOINT_STATE, [joint_state_message(each, each.stamp.ns) for each in joints]),
    ):
        decoder, data = message_decoder(kind), [cdr(kind, each)[1] for each in messages]
        batch, _ = DECODED[kind]
        assert decoder.batch(data, batch) == [None] * 20, "no layout is known"
        decoder(data[0])
        assert None not in decoder.batch(data, batch)
        other_names = data[0].replace(b"needle", b"stylus").replace(b"a\0", b"c\0")
        changed = decoder.batch([*data, other_names], batch)
        assert [each is None for each in changed] == [False] * 20 + [True]


def test_a_topic_is_left_out_at_the_same_message(tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "_MAX_UNREADABLE", 20)
    transform = Transform("tracker", "needle", np.eye(3), np.zeros(3))
    good = [
        cdr(
            TRACKED_TRANSFORM,
            tracked_transform_message(TrackedTransform.valid(transform, Stamp(n))),
        )
        for n in range(60)
    ]
    bad = (TRACKED_TRANSFORM, good[0][1] + struct.pack("<I", 9))
    messages = [*good[:10], *[bad] * 21, *good[10:30], *[bad] * 8, *good[30:]]
    write(tmp_path / "x.mcap", messages)
    expected = one_by_one(tmp_path / "x.mcap", monkeypatch)
    assert 10 <= len(expected.frames) < 60
    assert outcome(tmp_path / "x.mcap") == expected
