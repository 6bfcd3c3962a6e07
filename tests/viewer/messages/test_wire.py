"""The bytes of messages, without a server."""

import struct

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st
from wslink.chunking import UnChunker

from app.viewer.messages.checks import MessageError
from app.viewer.messages.open_pages import (
    MAX_MESSAGE_BYTES,
    Request,
    decode_request,
    encode_answer,
    encode_error,
    encode_publication,
)

CALL = {"wslink": "1.0", "id": "rpc:page1:3", "method": "marginguard.seen", "args": [7]}


def framed(content, offset=0, size=None):
    return struct.pack("<III", 9, offset, len(content) if size is None else size) + content


def test_request_of_a_page_is_decoded():
    request = decode_request(framed(msgpack.packb({**CALL, "kwargs": {}})))
    assert request == Request("rpc:page1:3", "marginguard.seen", (7,))


@pytest.mark.parametrize(("offset", "size"), [(0, 0xFFFF_FFFF), (1, None), (0, 1), (0, 0)])
def test_header_must_describe_the_message(offset, size):
    with pytest.raises(MessageError, match="message header: offset"):
        decode_request(framed(msgpack.packb(CALL), offset, size))


@pytest.mark.parametrize("length", [0, 1, 12, MAX_MESSAGE_BYTES + 1])
def test_length_of_a_message_is_limited(length):
    with pytest.raises(MessageError, match=f"message: {length} bytes; expected"):
        decode_request(bytes(length))


@pytest.mark.parametrize(
    "changed",
    [
        *({"id": each} for each in ("", "rpc:a", "publish:a:0", "rpc:\u0661:1", "rpc:a:1\n", 7)),
        *({"method": each} for each in (None, 7, ["a"])),
        *({"args": each} for each in (None, {}, "ab", [0] * 65)),
        *({"kwargs": each} for each in ({"a": 1}, [1], "a")),
    ],
)
def test_other_parts_are_refused(changed):
    with pytest.raises(MessageError):
        decode_request(framed(msgpack.packb({**CALL, **changed})))


@given(st.binary(max_size=300), st.booleans())
def test_random_bytes_are_decoded_or_refused(content, whole):
    try:
        request = decode_request(framed(content) if whole else content)
    except MessageError:
        return
    assert isinstance(request.method, str)


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        (encode_answer("rpc:a:1", [1]), {"wslink": "1.0", "id": "rpc:a:1", "result": [1]}),
        (
            encode_error("rpc:a:1", "no"),
            {"wslink": "1.0", "id": "rpc:a:1", "error": {"code": -32001, "message": "no"}},
        ),
        (
            encode_publication("a.b", {"c": b"\xff" * 5_000_000}),
            {"wslink": "1.0", "id": "publish:a.b:0", "result": {"c": b"\xff" * 5_000_000}},
        ),
    ],
)
def test_messages_to_a_page_are_those_of_wslink(frames, expected):
    chunks = UnChunker()
    chunks.set_max_message_size(10_000_000)
    assert [chunks.process_chunk(frame) for frame in frames][-1] == expected
