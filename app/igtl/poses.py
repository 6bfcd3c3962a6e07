"""Convert TRANSFORM and TDATA messages to tracked transforms with their status.

========= =================== ===================================== =======================
message   transform name      status (metadata, header version 2)   time
========= =================== ===================================== =======================
TRANSFORM device name         ``TransformStatus``; older servers    header
                              send only ``TransformValid``
TDATA     one per element     ``<name>Status``                      header, for all
========= =================== ===================================== =======================

``StylusToTracker`` is the frame ``stylus`` in ``tracker``. Numbers are mm along the server's axes
and are not converted. A name has 20 bytes at most. PLUS truncates longer names, which then refer
to a frame that does not exist (``...ToReferenc``).
`wire` says why the messages of pyigtl are not used.
"""

import math
import struct
from collections.abc import Iterator, Mapping

import numpy as np

from app.geometry import (
    NS_PER_S,
    FrameError,
    MarginGuardError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    TransformError,
    split_transform_name,
)
from app.igtl.errors import IgtlContentError, IgtlLimitError, IgtlStampError
from app.igtl.stream import Refusals
from app.igtl.wire import Message

TYPES = ("TRANSFORM", "TDATA")
MAX_EDGES = 256
"""Limit on the number of different transforms, which bounds the memory."""

_LAST_SECOND = 2**31 - 1  # of a ROS time
_MATRIX = struct.Struct(">12f")
_ELEMENT = struct.Struct(">20sBx12f")
_FULL_POSES = (1, 2)
"""TDATA element types tracker and 6D. Others (3D, 5D) have no complete measured orientation."""

_OTHER_WORDS = {"REQ_TIMEOUT": TrackingStatus.REQUEST_TIMEOUT}


class PoseReader:
    """Reads messages; adds invalid messages and TDATA elements to ``refusals``.

    ``without_status`` counts samples without a status (header version 1 has no field for it). They
    are treated as valid, like those of a recording without statuses.
    """

    def __init__(self, refusals: Refusals) -> None:
        self.without_status = 0
        self._refusals = refusals
        self._edges: set[tuple[str, str]] = set()

    def read(self, message: Message) -> list[TrackedTransform]:
        """Samples of a message of one of `TYPES`, in its order."""
        samples = []
        try:
            stamp = _stamp(message)
            for name, numbers, status in _poses(message):
                try:
                    samples.append(self._sample(name, numbers, stamp, status))
                except MarginGuardError as error:
                    self._refusals.add(error)
        except MarginGuardError as error:
            self._refusals.add(error)
        return samples

    def _sample(
        self, name: str, numbers: tuple[float, ...], stamp: Stamp, status: TrackingStatus | None
    ) -> TrackedTransform:
        frames = split_transform_name(name)
        if frames is None:
            raise FrameError(f"transform name is {name!r}; expected the form AToB")
        if frames not in self._edges:
            if len(self._edges) >= MAX_EDGES:
                raise IgtlLimitError(
                    f"transform {name!r} is one too many; expected at most {MAX_EDGES}"
                )
            self._edges.add(frames)
        if status is None:
            self.without_status += 1
        return _tracked(frames, numbers, stamp, status or TrackingStatus.OK)


def _stamp(message: Message) -> Stamp:
    if not 0 < message.stamp_ns < _LAST_SECOND * NS_PER_S:
        raise IgtlStampError(
            f"{message.type} {message.device!r} has the time {message.stamp_ns} ns; "
            f"expected more than 0 and less than {_LAST_SECOND} s"
        )
    return Stamp(message.stamp_ns)


def _poses(
    message: Message,
) -> Iterator[tuple[str, tuple[float, ...], TrackingStatus | None]]:
    """Name, columns of the matrix (rotation, then translation) and status, None if missing."""
    if message.type == "TRANSFORM":
        if len(message.content) != _MATRIX.size:
            raise IgtlContentError(
                f"TRANSFORM {message.device!r} has {len(message.content)} bytes; "
                f"expected {_MATRIX.size}"
            )
        yield message.device, _MATRIX.unpack(message.content), _status(message.metadata)
        return
    if len(message.content) % _ELEMENT.size:
        raise IgtlContentError(
            f"TDATA {message.device!r} has {len(message.content)} bytes; "
            f"expected elements of {_ELEMENT.size} bytes"
        )
    for raw_name, kind, *numbers in _ELEMENT.iter_unpack(message.content):
        # A name that is not ASCII is refused later; the error then shows its bytes.
        name = raw_name.rstrip(b"\0").decode("ascii", "backslashreplace")
        status = _status_of_word(message.metadata.get(f"{name}Status"))
        if kind not in _FULL_POSES and status in (None, TrackingStatus.OK):
            status = TrackingStatus.INVALID
        yield name, tuple(numbers), status


def _status(metadata: Mapping[str, str]) -> TrackingStatus | None:
    status = _status_of_word(metadata.get("TransformStatus"))
    valid = metadata.get("TransformValid", "").strip().lower()
    if status in (None, TrackingStatus.OK) and valid not in ("", "1", "true"):
        return TrackingStatus.INVALID
    return status


def _status_of_word(word: str | None) -> TrackingStatus | None:
    if word is None:
        return None
    name = word.strip().upper().removeprefix("TOOL_")
    # An unknown status is not OK.
    known = _OTHER_WORDS.get(name) or TrackingStatus.__members__.get(name, TrackingStatus.INVALID)
    return TrackingStatus(known)


def _tracked(
    frames: tuple[str, str], numbers: tuple[float, ...], stamp: Stamp, status: TrackingStatus
) -> TrackedTransform:
    source, target = frames
    if status is TrackingStatus.OK and not all(map(math.isfinite, numbers)):
        status = TrackingStatus.NOT_FINITE
    if status is TrackingStatus.OK:
        columns = np.array(numbers).reshape(4, 3)
        try:
            transform = Transform(target, source, columns[:3].T, columns[3])
            return TrackedTransform(transform, stamp, status)
        except TransformError:
            status = TrackingStatus.NOT_RIGID
    return TrackedTransform.lost(target, source, stamp, status)
