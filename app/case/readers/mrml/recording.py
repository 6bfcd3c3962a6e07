"""Recordings of 3D Slicer: the sequences of transforms of a scene (``.mrml``) or bundle (``.mrb``).

SlicerIGT records one sequence per edge, with the time in seconds as its index. Slicer stores such a
sequence as an IGSIO header (``.seq.mha``, ``.seq.mhd``, ``.seq.nrrd``), or as a bundle of its own
(``.seq.mrb``) or a scene (``.seq.mrml``) with one node per item. Both have six digits.
"""

import heapq
import re
from collections.abc import Iterator
from pathlib import Path

from app.case.frames.assembly import FrameAssembler
from app.case.frames.samples import TrackingFrame
from app.case.readers.igsio.header import read_header, tracked_sample
from app.case.readers.mrml import MRML_ENDINGS
from app.case.readers.mrml.document import (
    ItemLimit,
    MrmlDocument,
    SequenceEntry,
    index_items,
    read_mrml_document,
)
from app.case.readers.mrml.files import MrmlFiles, inner_scene, open_mrml
from app.case.readers.recording_format import Note
from app.files.numbers import parse_numbers
from app.geometry import (
    FrameError,
    InputError,
    MarginGuardError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    split_transform_name,
)

_WORD = re.compile(r"[A-Za-z0-9]+")
_HEADER_ENDINGS = (".mha", ".mhd", ".nrrd")


def check_mrml(path: Path) -> None:
    """Raise `InputError` unless the scene at ``path`` and all its sequences are complete."""
    for _ in read_mrml(path, lambda note: None):
        pass


def read_mrml(path: Path, note: Note) -> Iterator[TrackingFrame]:
    """Yield the frames of the scene at ``path`` in the order of time, one frame per time.

    Times are those in the file of the sequence. A sequence whose name gives no pair of frames is
    skipped and reported to ``note``. Raises `InputError`, with the file, for content that is
    malformed, too large or outside the scene's folder, and for a scene without a sequence of
    transforms.
    """
    with open_mrml(path) as files:
        limit = ItemLimit()
        scene = read_mrml_document(files.scene(), files.where, limit)
        tracks = [
            _samples(files, entry, frames, limit, note)
            for entry in scene.sequences
            if (frames := _frames_of(entry.name, note)) is not None
        ]
        if not tracks:
            raise InputError(f"{path} holds no sequence of transforms over time")
        assembler = FrameAssembler(note)
        for sample in heapq.merge(*tracks, key=_ns):
            yield from assembler.add_pose(sample)
        yield from assembler.flush()


def _ns(sample: TrackedTransform) -> int:
    return sample.stamp.ns


def _frames_of(name: str, note: Note) -> tuple[str, str] | None:
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


def _samples(
    files: MrmlFiles,
    entry: SequenceEntry,
    frames: tuple[str, str],
    limit: ItemLimit,
    note: Note,
) -> Iterator[TrackedTransform]:
    """Yield all samples of a sequence in the order of time, lost ones included."""
    where = f"{files.where}: {entry.file_name}"
    held = _held(files, entry, frames, limit, where, note)
    lost = [
        TrackedTransform.lost(frames[1], frames[0], _stamp(time, where), _lost_status(word, where))
        for time, word in entry.lost
    ]
    yield from heapq.merge(held, sorted(lost, key=_ns), key=_ns)


def _held(
    files: MrmlFiles,
    entry: SequenceEntry,
    frames: tuple[str, str],
    limit: ItemLimit,
    where: str,
    note: Note,
) -> Iterator[TrackedTransform]:
    name = entry.file_name.lower()
    count = 0
    with files.open(entry.file_name) as file:
        if name.endswith(_HEADER_ENDINGS):

            def frames_of(field: str) -> tuple[str, str] | None:
                return frames if _frames_of(field, note) == frames else None

            for frame in read_header(file, where, frames_of, note):
                count += len(frame.poses)
                yield from frame.poses
        elif name.endswith(MRML_ENDINGS):
            inner = read_mrml_document(inner_scene(files, file, name, where), where, limit)
            for sample in _items(inner, entry, frames, where):
                count += 1
                yield sample
        else:
            raise InputError(
                f"{where} cannot be read; expected one of "
                f"{', '.join((*_HEADER_ENDINGS, *MRML_ENDINGS))}"
            )
    if not count:
        raise InputError(f"{where} holds no sample of {entry.name}")


def _items(
    scene: MrmlDocument, entry: SequenceEntry, frames: tuple[str, str], where: str
) -> Iterator[TrackedTransform]:
    for identity, time in index_items(entry.index, where):
        node = scene.transforms.get(identity)
        if node is None:
            raise InputError(
                f"{where} has no transform {identity!r}, which the sequence has at {time} s"
            )
        numbers = parse_numbers(node.matrix, 16, f"{where}: {identity}")
        yield tracked_sample(numbers, node.status, frames, _stamp(time, where))


def _stamp(time: str, where: str) -> Stamp:
    try:
        return Stamp.from_seconds(time)
    except MarginGuardError as error:
        raise InputError(f"{where}: {error}") from error


def _lost_status(word: str, where: str) -> TrackingStatus:
    status = TrackingStatus.__members__.get(word, TrackingStatus.OK)
    if status is TrackingStatus.OK:
        raise InputError(
            f"{where}: a lost sample has status {word[:60]!r}; expected a known one that is not OK"
        )
    return status
