"""The bytes of messages: msgpack below wslink's header, within limits.

wslink allocates the size that a header claims, up to 4 GB. Here one frame is one message, and a
header that claims another size is refused.
"""

import re
from dataclasses import dataclass
from typing import Any

import msgpack
from wslink.chunking import HEADER_LENGTH, generate_chunks

from app.viewer.messages.errors import MessageError

MAX_MESSAGE_BYTES = 16_384
"""Largest message from a page, with its header. Pages send up to 300 bytes; a long error more."""
_MAX_ITEMS = 64
"""Items of a list or a mapping in a message."""
_MAX_FRAME_BYTES = 4 * 1024 * 1024
"""Larger messages to a page are split."""
_UINT32_BYTES = 4
_ID = re.compile(r"(rpc|system):[A-Za-z0-9]{0,64}:[0-9]{1,16}", re.ASCII)


@dataclass(frozen=True, slots=True)
class Request:
    """A call of ``method`` by a page, whose answer carries ``id``."""

    id: str
    method: str
    args: tuple[Any, ...]


def decode_request(frame: bytes) -> Request:
    """Return the request in a binary frame. Raises `MessageError` for anything else."""
    if not HEADER_LENGTH < len(frame) <= MAX_MESSAGE_BYTES:
        raise MessageError(
            f"message: {len(frame)} bytes; "
            f"expected more than {HEADER_LENGTH}, at most {MAX_MESSAGE_BYTES}"
        )
    header, content = frame[_UINT32_BYTES:HEADER_LENGTH], frame[HEADER_LENGTH:]
    offset = int.from_bytes(header[:_UINT32_BYTES], "little")
    size = int.from_bytes(header[_UINT32_BYTES:], "little")
    if offset != 0 or size != len(content):
        raise MessageError(
            f"message header: offset {offset}, size {size}; expected 0, {len(content)}"
        )
    return _request(_unpacked(content))


def encode_answer(request_id: str, result: object) -> list[bytes]:
    """Return the frames of an answer to a request."""
    return _frames({"wslink": "1.0", "id": request_id, "result": result})


def encode_error(request_id: str, text: str) -> list[bytes]:
    """Return the frames of an answer that says why a request was refused."""
    return _frames({"wslink": "1.0", "id": request_id, "error": {"code": -32001, "message": text}})


def encode_publication(topic: str, data: object) -> list[bytes]:
    """Return the frames of a message to the subscribers of ``topic``."""
    return _frames({"wslink": "1.0", "id": f"publish:{topic}:0", "result": data})


def _frames(message: dict[str, object]) -> list[bytes]:
    return list(generate_chunks(msgpack.packb(message), _MAX_FRAME_BYTES))


def _unpacked(content: bytes) -> object:
    try:
        return msgpack.unpackb(
            content,
            strict_map_key=True,
            max_array_len=_MAX_ITEMS,
            max_map_len=_MAX_ITEMS,
            max_ext_len=0,
        )
    # Also StackError for deep nesting, UnicodeDecodeError, and OverflowError of a number.
    except (ValueError, msgpack.UnpackException, OverflowError) as error:
        raise MessageError(f"message: {type(error).__name__}; expected msgpack") from error


def _request(message: object) -> Request:
    if not isinstance(message, dict):
        raise MessageError("message: no mapping; expected wslink, id, method, args, kwargs")
    request_id, method, args = (message.get(key) for key in ("id", "method", "args"))
    if not isinstance(request_id, str) or not _ID.fullmatch(request_id):
        raise MessageError("message id: unknown form; expected 'rpc:CLIENT:NUMBER'")
    if not isinstance(method, str) or not isinstance(args, list):
        raise MessageError("message: no method with args; expected text and a list")
    if message.get("kwargs"):
        raise MessageError("message kwargs: not empty; expected none")
    return Request(request_id, method, tuple(args))
