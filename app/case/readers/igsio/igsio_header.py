"""Headers of sequence metafiles (``.igs.mha``, ``.seq.nrrd``, ...), read line by line.

The header holds all tracking data: ``Seq_Frame0000_StylusToTrackerTransform = 16 numbers`` (row by
row, mm), its ``...Status``, ``Timestamp`` and ``UnfilteredTimestamp`` in seconds. Images may follow
the header or lie in a second file, compressed or not: `app.case.images` reads them.

Not by SimpleITK, which is an optional dependency: each line and the number of fields are bounded.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

from app.case.frame_streams import TrackingFrame, agreed_sample
from app.case.readers.recording_format import Note
from app.files.bounded_io import open_for_reading
from app.files.numbers import parse_numbers, parse_stamp
from app.geometry import (
    NS_PER_S,
    FrameError,
    InputError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    TransformError,
    snake_case,
    split_transform_name,
)

DEFAULT_PARENT = "tracker"
"""The target of a transform that is named without ``To``."""

FramesOf = Callable[[str], tuple[str, str] | None]

_FRAME_FIELD = re.compile(r"Seq_Frame(\d{1,9})_(\S+)", re.ASCII)
_STATUS_SUFFIX, _TRANSFORM_SUFFIX = "TransformStatus", "Transform"
_WORD = re.compile(r"[A-Za-z0-9]+")
_MAX_LINE_BYTES = 1_000_000
_MAX_FRAME_FIELDS = 1024
_MAX_TRANSFORMS = 1024


def check_igsio_header(path: Path) -> None:
    """Raise `InputError` unless the header of ``path`` is complete; reads the header only."""
    with open_for_reading(path) as file:
        for _ in _fields(file, str(path)):
            pass


def read_igsio(path: Path, note: Note, rate_hz: float | None = None) -> Iterator[TrackingFrame]:
    """Yield the frames of ``path`` in the file's order, across clock jumps; see `read_header`.

    Slicer's sequences (``.seq.``) have more than the two frames in the name of a transform. Raises
    `InputError` for a file without a transform as well.
    """
    names = FrameNames(note, words=".seq." in path.name.lower())
    frames = poses = 0
    with open_for_reading(path) as file:
        for frame in read_header(file, str(path), names.of, note, rate_hz):
            frames += 1
            poses += len(frame.poses)
            yield frame
    if not poses and not names.seen:
        raise InputError(
            f"{path} holds {frames} images without tracking; expected fields like "
            "Seq_Frame0000_StylusToTrackerTransform"
        )


def read_header(
    file: IO[bytes], path: str, frames_of: FramesOf, note: Note, rate_hz: float | None = None
) -> Iterator[TrackingFrame]:
    """Yield the frames of a header in its order; the ending of ``path`` gives the syntax.

    A missing status counts as OK; numbers that are not a pose become NOT_FINITE or NOT_RIGID. A
    frame without a time is skipped and reported to ``note``. With ``rate_hz`` the header must have
    no times, and frame n is at n / ``rate_hz`` s. ``frames_of`` returns source and target for the
    name of a transform, or None to skip it. Raises `InputError`, with the line, for malformed text,
    and for a header without any frame.
    """
    count = skipped = 0
    has_transform = False
    for draft in header_frames(file, path):
        has_transform = has_transform or any(map(is_transform, draft.fields))
        if frame := _tracking_frame(draft, path, frames_of, note, rate_hz):
            count += 1
            yield frame
        else:
            skipped += 1
    if not count and not has_transform:
        raise InputError(
            f"{path} is not a recording of a tracker: its header has no field like "
            "Seq_Frame0000_StylusToTrackerTransform"
        )
    if not count:
        raise InputError(
            f"{path} holds no frame with a Timestamp, but {skipped} without; expected times, or "
            "the rate of the frames (recording.rate_hz of a case.yaml, --rate-hz)"
        )
    if rate_hz is not None:
        note(f"the frames have no times: taken at {rate_hz:g} Hz, as stated")


@dataclass(slots=True)
class FrameFields:
    """The fields of one frame of a header: (line, value) by name."""

    index: int
    fields: dict[str, tuple[int, str]] = field(default_factory=dict)

    def stamp(self, path: str, name: str = "Timestamp") -> Stamp | None:
        """The time in the field ``name``, None without it; `InputError` for another text."""
        if name not in self.fields:
            return None
        return parse_stamp(*self._field(path, name))

    def matrix(self, path: str, name: str) -> tuple[list[float], str]:
        """The 16 numbers of the transform ``name`` and its status; a missing one counts as OK."""
        value, place = self._field(path, name)
        numbers = parse_numbers(value, 16, place)
        return numbers, self.fields.get(f"{name}Status", (0, "OK"))[1]

    def _field(self, path: str, name: str) -> tuple[str, str]:
        """The text of a field, and its place in messages."""
        line, value = self.fields[name]
        return value, f"{path} line {line} (frame {self.index}, {name})"


def is_transform(name: str) -> bool:
    """True for the name of a frame's field that holds a transform."""
    return name.endswith(_TRANSFORM_SUFFIX)


def header_frames(
    file: IO[bytes], path: str, others: Callable[[str, str], None] | None = None
) -> Iterator[FrameFields]:
    """Yield the fields of each frame of a header; the ending of ``path`` gives the syntax.

    ``others`` takes key and value of the fields that belong to no frame. ``file`` is left at the
    first byte after the header. Raises `InputError`, with the line, for a repeated field, too many
    fields of a frame and frame numbers that do not rise.
    """
    draft: FrameFields | None = None
    for line, key, value in _fields(file, path):
        match = _FRAME_FIELD.fullmatch(key)
        if match is None:
            if others is not None:
                others(key, value)
            continue
        index = int(match[1])
        if draft is not None and index != draft.index:
            if index < draft.index:
                raise InputError(
                    f"{path} line {line}: frame {index} comes after frame {draft.index}; "
                    "expected rising numbers"
                )
            yield draft
            draft = None
        draft = draft or FrameFields(index)
        if len(draft.fields) >= _MAX_FRAME_FIELDS:
            raise InputError(
                f"{path} line {line}: frame {index} has more than {_MAX_FRAME_FIELDS} fields; "
                f"expected {_MAX_FRAME_FIELDS} or fewer"
            )
        if match[2] in draft.fields:
            raise InputError(
                f"{path} line {line} (frame {index}): {match[2]} is repeated, first in line "
                f"{draft.fields[match[2]][0]}"
            )
        draft.fields[match[2]] = (line, value)
    if draft is not None:
        yield draft


def _tracking_frame(
    draft: FrameFields, path: str, frames_of: FramesOf, note: Note, rate_hz: float | None
) -> TrackingFrame | None:
    """The frame of ``draft``; None when it has no Timestamp."""
    stamp = draft.stamp(path)
    if rate_hz is not None:
        if stamp is not None:
            raise InputError(
                f"{path}: frame {draft.index} has a Timestamp; expected none with a stated rate "
                f"({rate_hz:g} Hz)"
            )
        stamp = Stamp(round(draft.index * NS_PER_S / rate_hz))
    if stamp is None:
        note(f"frame {draft.index} has no Timestamp: skipped")
        return None
    poses: dict[tuple[str, str], TrackedTransform] = {}
    for name in filter(is_transform, draft.fields):
        frames = frames_of(name.removesuffix(_TRANSFORM_SUFFIX))
        if frames is not None:
            sample = tracked_sample(*draft.matrix(path, name), frames, stamp)
            known = poses.get(frames)  # two names may give the same frames
            poses[frames] = sample if known is None else agreed_sample(known, sample)
    return TrackingFrame(
        stamp, tuple(poses.values()), unfiltered_stamp=draft.stamp(path, "UnfilteredTimestamp")
    )


def tracked_sample(
    numbers: Sequence[float], status_name: str, frames: tuple[str, str], stamp: Stamp
) -> TrackedTransform:
    """The sample of 16 numbers, row by row, with the IGSIO status ``status_name``.

    ``frames`` are source and target.
    """
    source, target = frames
    # An unknown status at least means that the tracker did not report the pose as valid.
    status = TrackingStatus.__members__.get(status_name, TrackingStatus.INVALID)
    if status is TrackingStatus.OK and not np.isfinite(numbers).all():
        status = TrackingStatus.NOT_FINITE
    if status is TrackingStatus.OK:
        try:
            pose = Transform.from_matrix(numbers, target=target, source=source)
            return TrackedTransform(pose, stamp, status)
        except TransformError:
            status = TrackingStatus.NOT_RIGID
    return TrackedTransform.lost(target, source, stamp, status)


class FrameNames:
    """Splits transform names into source and target; each name is noted once.

    With ``words`` the frames are those of the one word like ``NeedleToReference`` in the name.
    """

    def __init__(self, note: Note, *, words: bool = False) -> None:
        self._note = note
        self._words = words
        self._known: dict[str, tuple[str, str] | None] = {}

    @property
    def seen(self) -> bool:
        """True if there was any name, also one that cannot be split."""
        return bool(self._known)

    def of(self, name: str) -> tuple[str, str] | None:
        """Source and target of a transform; None for a name that cannot be split."""
        if name not in self._known:
            if len(self._known) >= _MAX_TRANSFORMS:
                raise InputError(
                    f"transform {name!r} is one too many; expected {_MAX_TRANSFORMS} or fewer"
                )
            self._known[name] = self._split(name)
        return self._known[name]

    def _split(self, name: str) -> tuple[str, str] | None:
        if self._words:
            return frames_in_name(name, self._note)
        try:
            frames = split_transform_name(name)
            if frames is None:
                frames = (snake_case(name), DEFAULT_PARENT)
                self._note(
                    f"transform {name!r} names no target: taken as frame "
                    f"{frames[0]!r} in {DEFAULT_PARENT!r}"
                )
        except FrameError as error:
            self._note(f"transform {name!r} skipped: {error}")
            return None
        return frames


def frames_in_name(name: str, note: Note) -> tuple[str, str] | None:
    """Source and target by a name like ``NeedleToReference`` or ``NeedleToReference-Sequence``."""
    try:
        found = [frames for word in _WORD.findall(name) if (frames := split_transform_name(word))]
    except FrameError as error:
        note(f"sequence {name!r} skipped: {error}")
        return None
    if len(found) != 1:
        note(f"sequence {name!r} skipped: {len(found)} names like NeedleToReference; expected one")
        return None
    return found[0]


def _fields(file: IO[bytes], path: str) -> Iterator[tuple[int, str, str]]:
    """Yield line number, key and value of each field; `InputError` for a cut header."""
    nrrd = path.lower().endswith((".nrrd", ".nhdr"))
    last = "before any frame"
    line = 0
    while raw := file.readline(_MAX_LINE_BYTES + 1):
        line += 1
        if len(raw) > _MAX_LINE_BYTES:
            raise InputError(
                f"{path} line {line} is longer than {_MAX_LINE_BYTES} bytes: not a header"
            )
        text = raw.decode("utf-8", errors="replace").strip()
        if nrrd and not text and raw.endswith(b"\n"):
            return
        found = _nrrd_field(text, line) if nrrd else _mha_field(text)
        if found is None:
            if raw.endswith(b"\n"):
                raise InputError(f"{path} line {line}: {text[:60]!r} is not a header field")
            break
        key, value = found
        if key == "ElementDataFile" and not nrrd:
            yield line, key, value
            return
        if match := _FRAME_FIELD.match(key):
            last = f"in frame {int(match[1])}"
        if key:
            yield line, key, value
    missing = "the empty line that ends it" if nrrd else "its last field, ElementDataFile"
    raise InputError(f"{path} is cut at line {line}, {last}: the header lacks {missing}")


def _mha_field(text: str) -> tuple[str, str] | None:
    key, equals, value = text.partition("=")
    return (key.strip(), value.strip()) if equals else None


def _nrrd_field(text: str, line: int) -> tuple[str, str] | None:
    """Parse ``key:=value``, ``key: value``, a comment, or the magic in line 1."""
    if line == 1:
        return ("", "") if text.startswith("NRRD") else None
    if text.startswith("#"):
        return "", ""
    key, equals, value = text.partition(":=")
    if not equals:
        key, equals, value = text.partition(":")
    return (key.strip(), value.strip()) if equals else None
