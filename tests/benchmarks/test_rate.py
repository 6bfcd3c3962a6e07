"""Figures of the rate benchmark, and the receiver's decoding of the bytes."""

import numpy as np
import pytest
from marginguard_msgs.msg import FixtureConstraint
from rclpy.serialization import serialize_message

from benchmarks.harness.goals import missed
from benchmarks.harness.peer import seq_of
from benchmarks.rate.__main__ import figures, goals

pytestmark = pytest.mark.slow

MS = 1_000_000


def found(sent_ms, delays_ms, bare_ms, *, seqs=None, steps=0):
    sent = np.array(np.cumsum(sent_ms) * MS, dtype=np.int64)
    arrived = sent + np.array(np.broadcast_to(delays_ms, sent.shape) * MS, dtype=np.int64)
    rows = np.stack([np.arange(len(sent)) if seqs is None else seqs, arrived], axis=1)
    bare = np.array(np.cumsum(bare_ms) * MS, dtype=np.int64)
    return figures(sent, rows, bare, missed=0, steps=steps, cpu_s=0.5)


def test_steady_stream_meets_the_requirements():
    one = found(np.full(2021, 2000 / 2020), 0.2, np.ones(2001), steps=20)
    assert missed(goals(one)) == []
    assert one["mean_hz"] == pytest.approx(1010.0)
    assert one["beats_hz"] == pytest.approx(1000.0)
    assert (one["delay_p50_ms"], one["delay_max_ms"]) == pytest.approx((0.2, 0.2))


def test_each_missed_requirement_is_reported():
    ones = np.ones(2001)
    slow = found(1.01 * ones, 0.2, ones)
    assert "beats' rate is 990.10 Hz" in missed(goals(slow))[0]
    of_steps = found(ones, 0.2, ones, steps=20)
    assert "beats' rate is 990.00 Hz" in missed(goals(of_steps))[0]
    gap = np.concatenate([ones, [15.0], np.full(20, 0.1)])
    assert any("gap of 15.00 ms" in line for line in missed(goals(found(gap, 0.2, ones))))
    as_bad = np.concatenate([ones, [16.0]])
    assert not any("gap" in line for line in missed(goals(found(gap, 0.2, as_bad))))
    twice = np.arange(2001)
    twice[7] = 6
    assert any(
        "in order: False" in line for line in missed(goals(found(ones, 0.2, ones, seqs=twice)))
    )
    late = np.where(np.arange(2001) % 20 == 0, 3.0, 0.2)
    assert any("p99" in line for line in missed(goals(found(ones, late, ones))))


@pytest.mark.parametrize("frame", ["", "tumor", "a frame with a longer name", "örtlich"])
def test_receiver_reads_seq_at_its_cdr_offset(frame):
    message = FixtureConstraint(seq=2**63 + 5)
    message.header.frame_id = frame
    assert seq_of(serialize_message(message)) == 2**63 + 5
