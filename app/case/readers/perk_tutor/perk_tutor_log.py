"""Reads a ``TransformRecorderLog``.

``<log TimeStampSec="12" TimeStampNSec="5" type="transform" DeviceName="StylusToReference"
transform="16 numbers"/>``: seconds and nanoseconds, the matrix row by row in mm. The format does
not order its elements, and usually has one device after the other. The readers of PerkTutor are
modules of 3D Slicer, which is not loaded here.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from app.case.frame_streams import FrameAssembler, TrackingFrame
from app.case.readers.igsio.igsio_header import FrameNames, tracked_sample
from app.case.readers.perk_tutor import ROOT
from app.case.readers.recording_format import Note
from app.files.bounded_io import read_bounded
from app.files.numbers import parse_numbers
from app.files.xml_guard import walk_xml
from app.geometry import NS_PER_S, InputError, Stamp, TrackedTransform

_MAX_BYTES = 128_000_000
_SECONDS = re.compile(r"-?\d{1,10}", re.ASCII)
_NANOSECONDS = re.compile(r"\d{1,9}", re.ASCII)


def check_log(path: Path) -> None:
    """Raise `InputError` unless the log at ``path`` can be read."""
    _samples(path, lambda note: None)


def read_log(path: Path, note: Note) -> Iterator[TrackingFrame]:
    """Yield the frames of the log at ``path`` in the order of time, one frame per time.

    Messages of the log are counted in ``note``. Raises `InputError`, with the element, for
    malformed content and for a log without a transform.
    """
    samples = _samples(path, note)
    samples.sort(key=lambda sample: sample.stamp.ns)
    assembler = FrameAssembler(note)
    for sample in samples:
        yield from assembler.add_pose(sample)
    yield from assembler.flush()


@dataclass(slots=True)
class _Walk:
    path: Path
    names: FrameNames
    samples: list[TrackedTransform] = field(default_factory=list)
    elements: int = 0
    messages: int = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if not self.elements and tag != ROOT:
            raise InputError(f"{self.path} is a {tag[:60]!r}; expected a {ROOT}")
        self.elements += 1
        if tag != "log":
            return
        if attributes.get("type") != "transform":
            self.messages += 1
            return
        where = f"{self.path}: element {self.elements}"
        frames = self.names.of(attributes.get("DeviceName", ""))
        if frames is None:
            return
        numbers = parse_numbers(attributes.get("transform", ""), 16, f"{where}: transform")
        stamp = Stamp(
            NS_PER_S * _integer(attributes, "TimeStampSec", _SECONDS, where)
            + _integer(attributes, "TimeStampNSec", _NANOSECONDS, where)
        )
        self.samples.append(tracked_sample(numbers, "OK", frames, stamp))


def _integer(attributes: dict[str, str], name: str, pattern: re.Pattern[str], where: str) -> int:
    text = attributes.get(name, "")
    if not pattern.fullmatch(text):
        raise InputError(f"{where}: {name} is {text[:60]!r}; expected an integer")
    return int(text)


def _samples(path: Path, note: Note) -> list[TrackedTransform]:
    walk = _Walk(path, FrameNames(note))
    walk_xml(read_bounded(path, _MAX_BYTES), path, start=walk.start)
    if not walk.samples:
        raise InputError(f"{path} holds no transform with a name like StylusToReference")
    if walk.messages:
        note(f"{walk.messages} messages of the log are not read")
    return walk.samples
