"""Encoding and decoding compared with pyigtl, and invalid bytes."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyigtl.messages import CRC64, MessageBase

from app.igtl.framing import (
    IgtlContentError,
    IgtlError,
    IgtlFramingError,
    read_header,
    read_message,
    stamp_ns,
    start_tracking_request,
)
from tests.igtl.conftest import pose
from tests.oracles.pyigtl_peer import message

GOOD = message(matrix=pose(1, 2, 3), metadata={"TransformStatus": "OK", "Größe": "1"}).pack()


@pytest.mark.parametrize("version", [1, 2])
def test_messages_packed_by_pyigtl_are_read(version):
    metadata = {"TransformStatus": "OUT_OF_VIEW", "a": ""} if version == 2 else {}
    packed = message(
        matrix=pose(1, 2, 3), time_s=1_700_000_000.25, version=version, metadata=metadata
    ).pack()

    header = read_header(packed[:58])
    read = read_message(header, packed[58:])

    assert (header.version, header.body_bytes) == (version, len(packed) - 58)
    assert (read.type, read.device) == ("TRANSFORM", "StylusToTracker")
    assert read.stamp_ns == 1_700_000_000_250_000_000
    assert read.metadata == metadata
    columns = np.frombuffer(read.content, ">f4").reshape(4, 3)
    np.testing.assert_array_equal(columns.T, np.array(pose(1, 2, 3))[:3])


@given(st.integers(0, 2**32 * 10**9 - 1))
def test_time_is_exact_to_the_nanosecond(ns):
    assert stamp_ns((ns << 32) // 10**9) == ns


def test_pyigtl_reads_the_start_tracking_request():
    request = start_tracking_request()
    fields = MessageBase.parse_header(request[:58])
    assert (fields["message_type"], fields["header_version"]) == ("STT_TDATA", 2)
    assert fields["body_size"] == len(request) - 58
    assert struct.unpack(">Q", request[50:58])[0] == CRC64(request[58:])
    unpacked = MessageBase()
    contents: list[bytes] = []
    unpacked._unpack_content = contents.append
    unpacked.unpack(fields, request[58:])
    # Resolution 0 ms, coordinate system with an empty name in 32 bytes.
    assert contents == [bytes(36)]


@pytest.mark.parametrize(
    "damage",
    [
        b"HTTP/1.1 400 Bad Request\r\n",
        bytes(58),
        struct.pack(">H", 9) + GOOD[2:],
        GOOD[:2] + b"transform".ljust(12, b"\0") + GOOD[14:],
        GOOD[:42] + struct.pack(">Q", 2**63) + GOOD[50:],
    ],
)
def test_invalid_header_is_refused(damage):
    with pytest.raises(IgtlFramingError, match=r"OpenIGTLink header begins with .*; expected"):
        read_header(damage[:58].ljust(58, b"\0"))


@given(st.integers(58, len(GOOD) - 1), st.integers(1, 255))
def test_changed_body_is_refused(position, change):
    damaged = bytearray(GOOD)
    damaged[position] ^= change
    with pytest.raises(IgtlError, match="checksum"):
        read_message(read_header(GOOD[:58]), bytes(damaged[58:]))


@given(st.binary(max_size=200), st.sampled_from([1, 2, 3]))
def test_arbitrary_body_is_read_or_refused(body, version):
    """A valid checksum does not make a body valid: an attacker can compute it."""
    header = struct.pack(">H", version) + GOOD[2:42] + struct.pack(">QQ", len(body), CRC64(body))
    try:
        read = read_message(read_header(header), body)
    except IgtlContentError:
        return
    assert len(read.content) <= len(body)


@pytest.mark.parametrize("sizes", [(11, 0, 0), (12, 2000, 0), (12, 2, 2**32 - 1), (65535, 2, 0)])
def test_inconsistent_part_sizes_are_refused(sizes):
    body = struct.pack(">HHII", *sizes, 0) + bytes(50)
    header = GOOD[:42] + struct.pack(">QQ", len(body), CRC64(body))
    with pytest.raises(IgtlContentError, match="has parts of"):
        read_message(read_header(header), body)


def test_metadata_with_too_large_a_count_is_refused():
    body = struct.pack(">HHII", 12, 2, 0, 0) + bytes(48) + struct.pack(">H", 65535)
    header = GOOD[:42] + struct.pack(">QQ", len(body), CRC64(body))
    with pytest.raises(IgtlContentError, match="claims 65535 entries; expected at most 0"):
        read_message(read_header(header), body)
