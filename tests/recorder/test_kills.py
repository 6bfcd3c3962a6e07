"""A killed recorder loses only the end, and the comparison that finds what it loses."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from app.case import BagTopic, BagWriter
from app.geometry import NS_PER_MS
from tests.recorder.kills import PROMISED_MS, compared, run_kill
from tests.recorder.streams import streams
from tests.ros_domain import domain_id as domain_id

pytestmark = pytest.mark.slow

NOW_NS = 1_700_000_000 * 10**9


def test_killed_recorder_loses_only_the_last_messages(domain_id, tmp_path):
    kill = run_kill(tmp_path, 1.5)
    assert kill.recorded > 1000
    assert kill.in_mcap == kill.recorded
    # The promised 100 ms need a machine that is not busy: `test_twenty_kills`.
    assert kill.lost_ms < 1000.0


def written(folder: Path, topic: str, stamps_ns: Iterable[int]) -> Path:
    """A flushed recording of messages on ``topic`` with these stamps."""
    (stream,) = [each for each in streams() if each.topic.name == topic]
    bag = BagWriter(folder)
    bag.add_topic(BagTopic(topic, "x/msg/X", "uint8 x"))
    for ns in stamps_ns:
        data = bytearray(stream.messages[0])
        data[stream.stamp_at : stream.stamp_at + 8] = np.array(
            divmod(ns, 10**9), dtype=np.uint32
        ).tobytes()
        bag.write(topic, bytes(data), received_ns=ns, published_ns=ns)
    bag.flush()
    return folder / f"{folder.name}_0.mcap"


@pytest.mark.parametrize("topic", ["/tf", "/joint_states"])
@pytest.mark.parametrize(
    ("missing", "lost", "lost_ms", "missed"),
    [
        ((), 0, 0.0, 0),
        ((198, 199), 2, 10.0, 0),
        (tuple(range(170, 200)), 30, 150.0, 0),
        ((40, 199), 1, 5.0, 1),
    ],
    ids=["nothing", "the last ones", "too many", "one in the middle"],
)
def test_missing_messages_are_counted_back_from_the_kill(
    tmp_path, topic, missing, lost, lost_ms, missed
):
    sent = np.array([NOW_NS + index * 5 * NS_PER_MS for index in range(200)])
    killed_ns = NOW_NS + 200 * 5 * NS_PER_MS
    kept = [int(ns) for index, ns in enumerate(sent) if index not in missing]
    kill = compared(written(tmp_path / "bag", topic, kept), {topic: sent}, killed_ns)
    assert (kill.recorded, kill.lost, kill.lost_ms) == (len(kept), {topic: lost}, lost_ms)
    assert kill.missed == missed
    assert kill.is_good == (lost_ms <= PROMISED_MS)


def test_message_from_after_the_kill_is_not_missing(tmp_path):
    sent = np.array([NOW_NS, NOW_NS + 10])
    kill = compared(written(tmp_path / "bag", "/tf", [NOW_NS]), {"/tf": sent}, NOW_NS + 10)
    assert kill.lost == {"/tf": 0}
