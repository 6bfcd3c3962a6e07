import errno
import os
from pathlib import Path

import pytest
from mcap.reader import make_reader

from app.case import BagTopic, BagWriter
from app.case.readers.rosbag2.mcap_file import read_mcap_messages
from app.case.recorder.complete_file import CompleteFile

TOPIC = BagTopic("/words", "std_msgs/msg/String", "string data")


def read(path: Path) -> tuple[list[bytes], list[bytes], list[str]]:
    """Data of the messages by the MCAP library and by our reader, and the notes of ours."""
    with path.open("rb") as file:
        theirs = [message.data for _, _, message in make_reader(file).iter_messages()]
    notes: list[str] = []
    return theirs, [message.data for message in read_mcap_messages(path, notes.append)], notes


def test_file_is_complete_after_each_flush(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "bag")
    path = tmp_path / "bag" / "bag_0.mcap"
    assert read(path)[:2] == ([], [])
    bag.add_topic(TOPIC)
    expected = []
    for number in range(5):
        expected.append(b"%d" % number)
        bag.write("/words", expected[-1], received_ns=number, published_ns=number)
        bag.flush()
        theirs, ours, (note,) = read(path)
        assert theirs == ours == expected
        assert "has no index, as after a crash" in note and "marginguard recover" in note
    bag.close()
    assert read(path) == (expected, expected, [])


def test_failed_write_leaves_the_file_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
