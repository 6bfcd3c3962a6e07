import resource
import signal
from collections.abc import Iterator

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from app.case import BagTopic, BagWriter
from app.case.readers.rosbag2.mcap_file import read_mcap_messages
from app.geometry import InputError

TOPIC = BagTopic("/words", "std_msgs/msg/String", "string data", type_hash="RIHS01_00")
NS = 1_700_000_000_000_000_000


def write(bag: BagWriter, number: int, size: int = 16) -> None:
    # Incompressible bytes.
    data = b"".join(hash((number, at)).to_bytes(8, "little", signed=True) for at in range(size))
    bag.write("/words", data, received_ns=NS + number, published_ns=NS + number - 1)


def test_a_bag_is_read_by_rosbags_and_by_mcap(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    bag.add_topic(TOPIC)
    for number in range(10):
        write(bag, number)
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
    bag.add_topic(TOPIC)
    for number in range(5):
        write(bag, number)
    bag.flush()
    write(bag, 5)
    notes: list[str] = []
    found = list(read_mcap_messages(tmp_path / "bag" / "bag_0.mcap", notes.append))
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
    bag.add_topic(TOPIC)
    flushed = 0
    with pytest.raises(InputError, match=r"cannot be written: .*; up to .* messages") as refusal:
        for number in range(100_000):
            write(bag, number, size=200)
            if number % 10 == 9:
                bag.flush()
                flushed = number + 1
    assert "\n" not in str(refusal.value)
    with pytest.raises(InputError, match="cannot be written: an earlier write failed"):
        write(bag, 0)
    bag.close()
    found = list(read_mcap_messages(tmp_path / "bag" / "bag_0.mcap", lambda note: None))
    assert flushed > 50
    assert len(found) >= flushed
    assert not (tmp_path / "bag" / "metadata.yaml").exists()
