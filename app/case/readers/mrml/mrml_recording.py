"""Recordings of 3D Slicer: the sequences of transforms of a scene (``.mrml``) or bundle (``.mrb``).

SlicerIGT records one sequence per edge, with the time in seconds as its index. Slicer stores such a
sequence as an IGSIO header (``.seq.mha``, ``.seq.mhd``, ``.seq.nrrd``), or as a bundle of its own
(``.seq.mrb``) or a scene (``.seq.mrml``) with one node per item, whose matrix has six digits or is
in an ``.h5`` file. A bundle of one sequence is a recording, too: it holds the index as well.
"""

import heapq
from collections.abc import Iterator
from pathlib import Path

from app.case.frame_streams import FrameAssembler, TrackingFrame
from app.case.readers.igsio.igsio_header import frames_in_name, read_header, tracked_sample
from app.case.readers.mrml import MRML_ENDINGS
from app.case.readers.mrml.mrml_scene import (
    ItemLimit,
    MrmlDocument,
    MrmlFiles,
    SequenceEntry,
    index_items,
    open_inner,
    open_mrml,
    read_mrml_document,
)
from app.case.readers.recording_format import Note
from app.files.numbers import parse_numbers, parse_stamp
from app.files.transforms import read_hdf5_matrices
from app.geometry import (
    InputError,
    TrackedTransform,
    TrackingStatus,
)

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
            _samples(files, scene, entry, frames, limit, note)
            for entry in scene.sequences
            if (frames := _frames_of(entry, scene, path, note)) is not None
        ]
        if not tracks:
            others = ", ".join(scene.other_classes)
            raise InputError(
                f"{path} holds no sequence of transforms over time"
                f"{f', but of {others}' if others else ''}"
            )
        assembler = FrameAssembler(note)
        for sample in heapq.merge(*tracks, key=_ns):
            yield from assembler.add_pose(sample)
        yield from assembler.flush()


def _ns(sample: TrackedTransform) -> int:
    return sample.stamp.ns


def _frames_of(
    entry: SequenceEntry, scene: MrmlDocument, path: Path, note: Note
) -> tuple[str, str] | None:
    """Source and target by the name of a sequence; in a bundle of one sequence also by others.

    The index in a ``.seq.mrb`` has no name: its items and the file have.
    """
    if entry.file_name:
        return frames_in_name(entry.name, note)
    first = next(index_items(entry.index, str(path)), ("", ""))[0]
    item = scene.transforms.get(first)
    for name in (entry.name, "" if item is None else item.name):
        found = frames_in_name(name, lambda _: None)
        if found is not None:
            return found
    return frames_in_name(path.name, note)


def _samples(
    files: MrmlFiles,
    scene: MrmlDocument,
    entry: SequenceEntry,
    frames: tuple[str, str],
    limit: ItemLimit,
    note: Note,
) -> Iterator[TrackedTransform]:
    """Yield all samples of a sequence in the order of time, lost ones included."""
    if entry.file_name:
        where = f"{files.where}: {entry.file_name}"
        held = _held(files, entry, frames, limit, where, note)
    else:
        where = files.where
        held = _items(files, scene, entry, frames, where)
    lost = [
        TrackedTransform.lost(
            frames[1], frames[0], parse_stamp(time, where), _lost_status(word, where)
        )
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
                return frames if frames_in_name(field, note) == frames else None

            for frame in read_header(file, where, frames_of, note):
                count += len(frame.poses)
                yield from frame.poses
        elif name.endswith(MRML_ENDINGS):
            with open_inner(files, file, entry.file_name, where) as inside:
                inner = read_mrml_document(inside.scene(), where, limit)
                for sample in _items(inside, inner, entry, frames, where):
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
    files: MrmlFiles,
    scene: MrmlDocument,
    entry: SequenceEntry,
    frames: tuple[str, str],
    where: str,
) -> Iterator[TrackedTransform]:
    """Yield the items of a sequence; those in ``.h5`` files are read together."""
    in_files = {
        node.file_name: None
        for identity, _ in index_items(entry.index, where)
        if (node := scene.transforms.get(identity)) is not None and not node.matrix
    }
    matrices = _matrices(files, list(in_files), where)
    for identity, time in index_items(entry.index, where):
        node = scene.transforms.get(identity)
        if node is None:
            raise InputError(
                f"{where} has no transform {identity!r}, which the sequence has at {time} s"
            )
        numbers = (
            parse_numbers(node.matrix, 16, f"{where}: {identity}")
            if node.matrix
            else matrices[node.file_name]
        )
        yield tracked_sample(numbers, node.status, frames, parse_stamp(time, where))


def _matrices(files: MrmlFiles, names: list[str], where: str) -> dict[str, list[float]]:
    """16 numbers, row by row, of each of these ``.h5`` files."""
    if not names:
        return {}
    contents = []
    for name in names:
        if not name:
            raise InputError(f"{where} has a transform without a matrix; expected one, or a file")
        with files.open(name) as file:
            contents.append(files.budget.read(file, f"{where}: {name}"))
    found = read_hdf5_matrices(contents, [f"{where}: {name}" for name in names])
    return {name: matrix.ravel().tolist() for name, matrix in zip(names, found, strict=True)}


def _lost_status(word: str, where: str) -> TrackingStatus:
    status = TrackingStatus.__members__.get(word, TrackingStatus.OK)
    if status is TrackingStatus.OK:
        raise InputError(
            f"{where}: a lost sample has status {word[:60]!r}; expected a known one that is not OK"
        )
    return status
