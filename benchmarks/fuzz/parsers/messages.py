"""Messages from a network: ROS messages in CDR, and the stream of an OpenIGTLink server."""

import struct
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from pyigtl.messages import CRC64

from app.case import JointSample, read_image_message, values_reader
from app.case.messages.cdr_reader import tf_reader
from app.case.messages.image_message import IMAGE
from app.case.messages.recorded_messages import (
    joint_state_bytes,
    tf_bytes,
    tracked_transform_bytes,
)
from app.case.messages.ros_messages import (
    JOINT_STATE,
    TF_MESSAGE,
    TIME_REFERENCE,
    TRACKED_TRANSFORM,
    ros_types,
    time_reference_message,
)
from app.case.messages.values import JointValues, PoseValues
from app.geometry import (
    ImageSample,
    ImageStatus,
    InputError,
    MarginGuardError,
    Stamp,
    TrackedTransform,
    Transform,
)
from app.igtl.images import MAX_IMAGE_BODY_BYTES, ImageReader, image_message
from app.igtl.poses import TYPES, PoseReader
from app.igtl.stream import MessageStream, Refusals
from benchmarks.fuzz.mutators.raw import RAW
from benchmarks.fuzz.parser import FuzzedParser, Mutator

_HEADER = struct.Struct(">H12s20sQQQ")
_STAMP = Stamp(1_700_000_000_000_000_000)


def _pose(source: str) -> TrackedTransform:
    transform = Transform("tracker", source, np.eye(3), np.array([1.0, 2.0, 3.0]))
    return TrackedTransform.valid(transform, _STAMP)


def _cdr(message: Any, kind: str) -> bytes:
    return bytes(ros_types().serialize_cdr(message, kind))


def _seeds(kind: str) -> Sequence[bytes]:
    tools = [_pose(name) for name in ("reference", "needle", "cautery")]
    if kind == TRACKED_TRANSFORM:
        return [tracked_transform_bytes(tools[1])]
    if kind == TF_MESSAGE:
        return [tf_bytes(tools), tf_bytes([])]
    if kind == JOINT_STATE:
        joints = JointSample(("waist", "shoulder"), (0.5, 1.5), _STAMP)
        return [joint_state_bytes(joints, _STAMP.ns)]
    return [_cdr(time_reference_message(_STAMP, _STAMP), kind)]


def _reader(kind: str) -> Any:
    """Reads the message twice, by a new layout and by a known one, and makes samples of it."""

    def parse(path: Path) -> None:
        data = path.read_bytes()
        read = values_reader(kind)
        read(data)
        values = read(data)
        for each in values if type(values) is tuple else [values]:
            if isinstance(each, PoseValues):
                each.sample()
            elif isinstance(each, JointValues):
                each.sample(offset_ns=0)

    return parse


def _read_tf(path: Path) -> None:
    try:
        tf_reader()(path.read_bytes())
    except ValueError as error:  # documented; its caller counts it
        raise InputError(str(error)) from error


def _igtl_message(kind: bytes, device: bytes, content: bytes, *, version: int = 2) -> bytes:
    body = content
    if version > 1:
        pairs = [(b"TransformStatus", b"OK"), (b"NeedleToTrackerStatus", b"INVALID")]
        heads = struct.pack(">H", len(pairs))
        heads += b"".join(struct.pack(">HHI", len(key), 3, len(value)) for key, value in pairs)
        values = b"".join(key + value for key, value in pairs)
        body = struct.pack(">HHII", 12, len(heads), len(values), 0) + content + heads + values
    time = 1_700_000_000 << 32
    return _HEADER.pack(version, kind, device, time, len(body), CRC64(body)) + body


def _igtl_seeds() -> Sequence[bytes]:
    matrix = struct.pack(">12f", 1, 0, 0, 0, 1, 0, 0, 0, 1, 10, 20, 30)
    element = b"NeedleToTracker".ljust(20, b"\0") + b"\2\0" + matrix
    transform = _igtl_message(b"TRANSFORM", b"StylusToTracker", matrix)
    tracking = _igtl_message(b"TDATA", b"tools", element * 3)
    old = _igtl_message(b"TRANSFORM", b"StylusToTracker", matrix, version=1)
    other = _igtl_message(b"STATUS", b"s", bytes(30))
    return [transform + tracking, tracking, old + other + transform]


def _change_body(data: bytes, random: Random) -> bytes:
    """Change the body of the first message; the size and the checksum stay right."""
    if len(data) < _HEADER.size:
        return data
    version, kind, device, time, size, _ = _HEADER.unpack_from(data)
    body = data[_HEADER.size : _HEADER.size + min(size, len(data))]
    changed = random.choice(RAW)(body, random)[:100_000]
    head = _HEADER.pack(version, kind, device, time, len(changed), CRC64(changed))
    return head + changed + data[_HEADER.size + len(body) :]


def _read_stream(path: Path) -> None:
    """Feed the bytes in parts; a refused message is an error of the client, as in diagnostics."""
    data = path.read_bytes()
    refusals = Refusals()
    stream, reader = MessageStream(TYPES, refusals), PoseReader(refusals)
    for at in range(0, len(data), 1 << 16):
        for message in stream.feed(data[at : at + (1 << 16)]):
            reader.read(message)
    if refusals.last:
        raise MarginGuardError(refusals.last)


def _read_image_stream(path: Path) -> None:
    """As `_read_stream`, with images."""
    refusals = Refusals()
    stream = MessageStream(("IMAGE",), refusals, MAX_IMAGE_BODY_BYTES)
    reader = ImageReader(refusals)
    for message in stream.feed(path.read_bytes()):
        reader.read(message)
    if refusals.last:
        raise MarginGuardError(refusals.last)


def _image_seeds() -> Sequence[bytes]:
    pixels = np.arange(12, dtype=np.uint8).reshape(3, 4)
    colours = np.arange(36, dtype=np.uint8).reshape(3, 4, 3)
    return [
        image_message("Image", ImageSample(0, Stamp(1), ImageStatus.OK, each), np.eye(4))
        for each in (pixels, colours, pixels.astype(np.int16))
    ]


def _read_ros_image(path: Path) -> None:
    read_image_message(path.read_bytes(), 0)


def _ros_image_seeds() -> Sequence[bytes]:
    types = ros_types().types
    time = types["builtin_interfaces/msg/Time"](1_700_000_000, 0)
    header = types["std_msgs/msg/Header"](time, "image")
    return [
        _cdr(types[IMAGE](header, 3, 4, encoding, 0, size, np.arange(3 * size, dtype="u1")), IMAGE)
        for encoding, size in (("mono8", 4), ("mono16", 8), ("rgb8", 12))
    ]


_BODY: Sequence[Mutator] = (*[_change_body] * 2 * len(RAW), *RAW)

PARSERS = (
    *(
        FuzzedParser(
            name,
            "message.cdr",
            _reader(kind),
            partial(_seeds, kind),
            RAW,
            names_file=False,
        )
        for name, kind in (
            ("cdr_tracked", TRACKED_TRANSFORM),
            ("cdr_tf", TF_MESSAGE),
            ("cdr_joints", JOINT_STATE),
            ("cdr_time", TIME_REFERENCE),
        )
    ),
    FuzzedParser(
        "cdr_tf_buffer", "message.cdr", _read_tf, partial(_seeds, TF_MESSAGE), RAW, names_file=False
    ),
    FuzzedParser(
        "cdr_image", "message.cdr", _read_ros_image, _ros_image_seeds, RAW, names_file=False
    ),
    FuzzedParser("igtl", "stream.bin", _read_stream, _igtl_seeds, _BODY, names_file=False),
    FuzzedParser(
        "igtl_image", "stream.bin", _read_image_stream, _image_seeds, _BODY, names_file=False
    ),
)
