"""Message streams split at arbitrary positions."""

import struct
import tracemalloc
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.igtl.framing import IgtlFramingError, MessageStream, Refusals
from tests.igtl.conftest import pose
from tests.oracles.pyigtl_peer import message

TEN_MEGABYTES = 10_000_000
FIRST = message(matrix=pose(1, 2, 3), time_s=1.0).pack()
TEXT = message("STRING", "Log", string="hello").pack()
LAST = message(matrix=pose(4, 5, 6), time_s=2.0, version=1).pack()


def started() -> tuple[MessageStream, Refusals]:
    refusals = Refusals()
    return MessageStream(("TRANSFORM",), refusals), refusals


@given(st.lists(st.integers(0, len(FIRST + TEXT + LAST)), max_size=30))
def test_messages_do_not_depend_on_chunk_boundaries(cuts):
    stream, _ = started()
    sent = FIRST + TEXT + LAST
    boundaries = [0, *sorted(cuts), len(sent)]
    read = []
    for begin, end in pairwise(boundaries):
        read += stream.feed(sent[begin:end])
    assert [each.stamp_ns for each in read] == [1_000_000_000, 2_000_000_000]
    assert (stream.complete, stream.ignored) == (3, 1)


def test_damaged_body_does_not_affect_other_messages():
    stream, refusals = started()
    damaged = FIRST[:-1] + bytes([FIRST[-1] ^ 1])
    assert len(stream.feed(FIRST + damaged + LAST)) == 2
    assert refusals.counts == {"IgtlChecksumError": 1}
    assert "checksum" in refusals.last


@pytest.mark.parametrize("kind", [b"TRANSFORM", b"IMAGE"])
def test_large_body_is_skipped_without_being_stored(kind):
    stream, refusals = started()
    huge = struct.pack(">H12s20sQQQ", 1, kind, b"X", 0, TEN_MEGABYTES, 0)
    piece = bytes(1 << 16)
    stream.feed(huge)
    tracemalloc.start()
    remaining = TEN_MEGABYTES
    while remaining:
        stream.feed(piece[: min(remaining, len(piece))])
        remaining -= min(remaining, len(piece))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 500_000
    assert len(stream.feed(LAST)) == 1
    assert refusals.counts == ({"IgtlLimitError": 1} if kind == b"TRANSFORM" else {})


def test_invalid_header_raises():
    stream, _ = started()
    with pytest.raises(IgtlFramingError):
        stream.feed(FIRST + b"\r\n" + LAST)
