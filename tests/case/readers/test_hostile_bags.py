"""MCAP files and databases made to exhaust memory or time are refused, or read in part."""

import resource
import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
import zstandard
from rosbags.rosbag2 import StoragePlugin

from app.case import SideTopics, read_mcap
from app.case.messages.ros_messages import TF_MESSAGE, TRACKED_TRANSFORM
from app.case.readers.rosbag2 import bag_frames
from app.case.readers.rosbag2.bag import read_bag
from app.geometry import InputError
from tests.case.readers.test_mcap import pose, tf, tracked, write_bag, write_messages
from tests.refusals import refused

pytestmark = pytest.mark.slow

MAGIC = b"\x89MCAP0\r\n"


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def chunk(content: bytes, size: int | None = None) -> bytes:
    """A chunk record with ``content``, which claims to unpack to ``size`` bytes."""
    packed = zstandard.compress(content)
    head = struct.pack("<QQQI", 0, 0, len(content) if size is None else size, 0)
    return record(6, head + text(b"zstd") + struct.pack("<Q", len(packed)) + packed)


def messages_of(path: Path) -> tuple[int, list[str]]:
    """Number of messages that can be read, and the notes."""
    notes: list[str] = []
    return sum(1 for _ in read_bag(path, notes.append)), notes


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "x.mcap"


@pytest.fixture
def grown_mb() -> Callable[[], float]:
    """Returns by how many MB the peak memory of this process has grown during the test."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return lambda: (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024


def test_chunks_that_unpack_to_much_are_refused(path, grown_mb):
    messages = record(5, struct.pack("<HIQQ", 1, 0, 0, 0)) * 100_000  # of an unknown channel
    path.write_bytes(MAGIC + chunk(messages) * 1000)
    assert path.stat().st_size < 2_000_000
    with pytest.raises(InputError, match="expected 256 times as many or less"):
        messages_of(path)
    assert grown_mb() < 300


def test_chunk_that_claims_more_than_allowed_is_skipped(path):
    write_messages(path, [tracked(pose(10**9))])
    bomb = chunk(bytes(200_000_000)) * 3
    path.write_bytes(MAGIC + bomb + path.read_bytes()[len(MAGIC) :])
    count, notes = messages_of(path)
    assert count == 1
    assert [note.split("skipped ")[1] for note in notes] == [
        "(a chunk has 200000000 bytes; expected 67108864 or less)"
    ] * 3


def test_chunk_of_other_records_is_skipped(path):
    path.write_bytes(MAGIC + chunk(bytes(9_000_000)))
    count, notes = messages_of(path)
    assert count == 0
    assert "a chunk holds opcode 0; expected schemas, channels, messages" in notes[0]


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        (50_000, "the definitions of the recording have 75"),
        (200_000, "tf2_msgs/msg/TFMessage has 3000000 bytes and is not read; expected 1048576"),
    ],
)
def test_long_definition_is_not_parsed(path, lines, problem):
    long = "".join(f"float64 {line:6}\n" for line in range(lines))
    write_messages(path, [tracked(pose(10**9)), tf(pose(10**9, "pointer"))], {"/tf": long})
    notes: list[str] = []
    (frame, *_) = read_mcap(path, notes.append, SideTopics())
    assert frame.poses[0].source == "cautery"
    assert problem in notes[0]


@pytest.mark.parametrize(
    "definition",
    [
        "string[10000000] transforms\n",
        "string[5000] transforms\n",
        "pkg/A transforms\n" + "=" * 80 + "\nMSG: pkg/A\npkg/A a\n",
        "int32 X=" + "9" * 5000 + "\n",
    ],
    ids=["array", "code", "recursive", "number"],
)
def test_definition_that_costs_memory_is_unusable(path, definition):
    write_messages(path, [tracked(pose(10**9)), tf(pose(10**9, "p"))], {"/tf": definition})
    notes: list[str] = []
    (frame,) = read_mcap(path, notes.append, SideTopics())
    assert [sample.source for sample in frame.poses] == ["cautery"]
    assert "the definition of tf2_msgs/msg/TFMessage in the recording cannot be used" in notes[0]
    assert len(notes[0]) < 400


def test_unusable_definition_is_parsed_once(path, monkeypatch):
    made, notes = [], []
    real = bag_frames.message_decoder

    def counted(kind: str, definition: str, *, idl: bool) -> object:
        made.append(kind)
        return real(kind, definition, idl=idl)

    monkeypatch.setattr(bag_frames, "message_decoder", counted)
    messages = [tracked(pose(10**9)), *[tf(pose(10**9 + i, "p")) for i in range(100)]]
    write_messages(path, messages, {"/tf": "no definition"})
    assert len(list(read_mcap(path, notes.append, SideTopics()))) == 1
    assert sorted(made) == [TRACKED_TRANSFORM, TF_MESSAGE]
    assert notes[-1] == "100 messages on /tf were skipped in all"


def test_topic_of_unreadable_messages_is_not_read_on(path, monkeypatch):
    assert bag_frames._MAX_UNREADABLE == 10_000
    monkeypatch.setattr(bag_frames, "_MAX_UNREADABLE", 100)
    bad, notes = ("/tf", TF_MESSAGE, b"\0\1\0\0\xff"), []
    write_messages(path, [tracked(pose(10**9)), *[bad] * 120, tf(pose(10**9, "p"))])
    (frame,) = read_mcap(path, notes.append, SideTopics())
    assert [sample.source for sample in frame.poses] == ["cautery"]
    assert notes[-1] == "121 messages on /tf were skipped in all"


def test_too_many_topics_are_refused(path):
    schema = record(3, struct.pack("<H", 1) + text(b"a/msg/A") + text(b"ros2msg") + text(b"x"))
    channels = b"".join(
        record(4, struct.pack("<HH", i % 60_000, 1) + text(b"/%d" % i) + text(b"cdr") + text(b""))
        for i in range(5000)
    )
    path.write_bytes(MAGIC + schema + channels)
    with pytest.raises(InputError, match="has more than 4096 topics"):
        messages_of(path)


@pytest.fixture
def bag(tmp_path) -> Path:
    """A bag with a database of ten messages; returns the database."""
    return write_bag(tmp_path / "bag", 10, StoragePlugin.SQLITE3)


def execute(path: Path, statement: str, *values: object) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute(statement, values)
        database.commit()


def test_huge_blob_is_skipped_without_being_loaded(bag, grown_mb):
    execute(bag, "UPDATE messages SET data = zeroblob(100000000) WHERE id = 3")
    count, notes = messages_of(bag.parent)
    assert count == 9
    assert notes == ["bag.db3: 1 messages have no data or exceed 67108864 bytes: skipped"]
    assert grown_mb() < 50


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT"


@pytest.mark.parametrize(
    ("statements", "problem"),
    [
        (["DROP TABLE messages"], "table messages lacks data"),
        (["ALTER TABLE messages RENAME TO m", f"CREATE VIEW messages AS {ENDLESS} i FROM n"],
         "table messages lacks"),
        (["DROP TABLE messages", "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, "
          "timestamp, data AS (zeroblob(60000000)))", "INSERT INTO messages VALUES (1, 1, 1)"],
         "table messages lacks data"),
        (["ALTER TABLE topics RENAME COLUMN type TO kind"], "table topics lacks type"),
        (["UPDATE topics SET name = zeroblob(9)"], "topic 1 has no name or type"),
        (["UPDATE messages SET data = zeroblob(9), topic_id = 1"], ""),
    ],
    ids=["missing", "view", "computed", "column", "name", "content"],
)  # fmt: skip
def test_hostile_database_is_refused(bag, statements, problem):
    for statement in statements:
        execute(bag, statement)
    with refused(text=problem):
        list(read_mcap(bag.parent, lambda note: None, SideTopics()))


def test_compressed_messages_of_a_database_are_unpacked(bag):
    expected = [message.data for message in read_bag(bag.parent, lambda note: None)]
    for number, data in enumerate(expected, start=1):
        packed = zstandard.compress(data)
        execute(bag, "UPDATE messages SET data = ? WHERE id = ?", packed, number)
    assert [message.data for message in read_bag(bag.parent, lambda note: None)] == expected
    bomb = zstandard.compress(bytes(100_000_000))
    execute(bag, "UPDATE messages SET data = ? WHERE id = 3", bomb)
    with pytest.raises(InputError, match="a message unpacks to more than"):
        list(read_bag(bag.parent, lambda note: None))


def test_database_that_was_not_closed_is_read_with_a_note(bag):
    (bag.parent / "metadata.yaml").unlink()
    bag.with_name(f"{bag.name}-wal").write_bytes(b"x")
    note = "bag.db3-wal is not read: the last messages of bag.db3 are missing"
    assert messages_of(bag.parent) == (10, [note])


def test_folder_without_a_recording_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"no \.mcap and no \.db3 file$"):
        messages_of(tmp_path)
    (tmp_path / "x.db3.zstd").touch()
    with pytest.raises(InputError, match=r"unpack its \.db3\.zstd files first"):
        messages_of(tmp_path)
