"""Recordings of 3D Slicer: the sequences of transforms of a scene, ``.mrml`` or bundle (``.mrb``).

As SlicerIGT records them: a sequence an edge, its index the time in seconds. Slicer keeps such a
sequence as an IGSIO header (``.seq.mha``, ``.seq.mhd``, ``.seq.nrrd``), or as a bundle of its own
(``.seq.mrb``) or a scene (``.seq.mrml``) with a node an item. Both have six digits.
"""

import heapq
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import IO, Protocol

from app.case.frame_assembly import FrameAssembler
from app.case.igsio import Note, read_header, sixteen_numbers, tracked_sample
from app.case.mrml_document import MrmlDocument, SequenceEntry, read_mrml_document
from app.case.paths import resolve_inside
from app.case.samples import TrackingFrame
from app.geometry import (
    FrameError,
    InputError,
    MarginGuardError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    split_transform_name,
)

MRML_ENDINGS = (".mrb", ".mrml")

_WORD = re.compile(r"[A-Za-z0-9]+")
_HEADER_ENDINGS = (".mha", ".mhd", ".nrrd")
_MAX_SCENE_BYTES = 256_000_000
"""Of all scenes of one recording together: the sequences of a scene are held at the same time."""
_MAX_HEADER_BYTES = 4_000_000_000
"""Of all files of sequences in one bundle, unpacked."""
_MAX_MEMBERS = 20_000
_CHUNK_BYTES = 1_000_000
_DAMAGE = (zipfile.BadZipFile, zlib.error, struct.error, EOFError, ValueError, RuntimeError)
"""What `zipfile` raises for damaged bytes, for a password and for methods that it does not know."""


def check_mrml(path: Path) -> None:
    """Raise `InputError` unless the scene at ``path`` and all its sequences are whole."""
    for _ in read_mrml(path, lambda note: None):
        pass


def read_mrml(path: Path, note: Note) -> Iterator[TrackingFrame]:
    """Yield the frames of the scene at ``path``: samples of one time are one frame.

    They come in the order of time, which is that of a sequence; times are taken as they are written
    in the sequence's file. A sequence whose name gives no pair of frames is told to ``note``.
    Raises `InputError`, with the place, for anything malformed, too large or outside of the
    scene's own folder, and for a scene without a sequence of transforms.
    """
    with _opened(path) as files:
        scene = read_mrml_document(files.scene(), files.place)
        tracks = [
            _samples(files, entry, frames, note)
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
    """Source and target: ``NeedleToReference``, in ``NeedleToReference-Sequence`` too."""
    try:
        found = [frames for word in _WORD.findall(name) if (frames := split_transform_name(word))]
    except FrameError as error:
        note(f"sequence {name!r} skipped: {error}")
        return None
    if len(found) != 1:
        note(f"sequence {name!r} skipped: one name as NeedleToReference wanted, {len(found)} found")
        return None
    return found[0]


def _samples(
    files: "_Files", entry: SequenceEntry, frames: tuple[str, str], note: Note
) -> Iterator[TrackedTransform]:
    """All samples of a sequence in the order of time, those that it does not hold among them."""
    place = f"{files.place}: {entry.file_name}"
    held = _held(files, entry, frames, place, note)
    lost = [
        TrackedTransform.lost(frames[1], frames[0], _stamp(time, place), _lost_status(word, place))
        for time, word in entry.lost
    ]
    yield from heapq.merge(held, sorted(lost, key=_ns), key=_ns)


def _held(
    files: "_Files", entry: SequenceEntry, frames: tuple[str, str], place: str, note: Note
) -> Iterator[TrackedTransform]:
    name = entry.file_name.lower()
    count = 0
    with files.open(entry.file_name) as file:
        if name.endswith(_HEADER_ENDINGS):

            def frames_of(field: str) -> tuple[str, str] | None:
                return frames if _frames_of(field, note) == frames else None

            for frame in read_header(file, place, frames_of, note):
                count += len(frame.poses)
                yield from frame.poses
        elif name.endswith(MRML_ENDINGS):
            inner = read_mrml_document(_inner_scene(files, file, name, place), place)
            for sample in _items(inner, entry, frames, place):
                count += 1
                yield sample
        else:
            raise InputError(
                f"{place} cannot be read: {', '.join((*_HEADER_ENDINGS, *MRML_ENDINGS))} can"
            )
    if not count:
        raise InputError(f"{place} holds no sample of {entry.name}")


def _inner_scene(files: "_Files", file: IO[bytes], name: str, place: str) -> bytes:
    content = files.budget.read(file, place)
    if name.endswith(".mrb"):
        with _Bundle.opened(BytesIO(content), place, files.budget) as bundle:
            return bundle.scene()
    return content


def _items(
    scene: MrmlDocument, entry: SequenceEntry, frames: tuple[str, str], place: str
) -> Iterator[TrackedTransform]:
    for identity, time in entry.index:
        node = scene.transforms.get(identity)
        if node is None:
            raise InputError(f"{place} has no transform {identity!r}, which is at {time} s")
        numbers = sixteen_numbers(node.matrix, f"{place}: {identity}")
        yield tracked_sample(numbers, node.status, frames, _stamp(time, place))


def _stamp(time: str, place: str) -> Stamp:
    try:
        return Stamp.from_seconds(time)
    except MarginGuardError as error:
        raise InputError(f"{place}: {error}") from error


def _lost_status(word: str, place: str) -> TrackingStatus:
    status = TrackingStatus.__members__.get(word, TrackingStatus.OK)
    if status is TrackingStatus.OK:
        raise InputError(
            f"{place}: a lost sample has status {word[:60]!r}: one that is not OK wanted"
        )
    return status


class _Budget:
    """How much may be read into memory yet, of all scenes of one recording."""

    def __init__(self) -> None:
        self._left_bytes = _MAX_SCENE_BYTES

    def read(self, file: IO[bytes], place: str) -> bytes:
        """All of ``file``; `InputError` where that is too much."""
        content = file.read(self._left_bytes + 1)
        if len(content) > self._left_bytes:
            raise InputError(
                f"{place}: the scenes of a recording have more than the {_MAX_SCENE_BYTES} bytes "
                "allowed"
            )
        self._left_bytes -= len(content)
        return content


class _Files(Protocol):
    """A scene file and what lies beside it; ``place`` is for messages."""

    place: str
    budget: _Budget

    def scene(self) -> bytes: ...

    def open(self, name: str) -> AbstractContextManager[IO[bytes]]: ...


@contextmanager
def _opened(path: Path) -> Iterator[_Files]:
    try:
        if path.suffix.lower() == ".mrb":
            with path.open("rb") as file, _Bundle.opened(file, str(path), _Budget()) as bundle:
                yield bundle
        else:
            yield _Folder(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from error


class _Folder:
    """An ``.mrml`` file; the files that it names may not lie outside of its folder."""

    def __init__(self, path: Path) -> None:
        self.place = str(path)
        self.budget = _Budget()
        self._path = path

    def scene(self) -> bytes:
        with self._path.open("rb") as file:
            return self.budget.read(file, self.place)

    @contextmanager
    def open(self, name: str) -> Iterator[IO[bytes]]:
        path = resolve_inside(self._path.parent, name, f"{self.place}: the file of a sequence")
        with path.open("rb") as file:
            yield file


class _Bundle:
    """A zip with one scene; its members are streamed and never unpacked to disk."""

    def __init__(self, bundle: zipfile.ZipFile, place: str, budget: _Budget) -> None:
        self.place = place
        self.budget = budget
        self._zip = bundle
        self._left_bytes = _MAX_HEADER_BYTES
        names = bundle.namelist()
        scenes = [PurePosixPath(name) for name in names if name.lower().endswith(".mrml")]
        # A sequence may be an .mrml file as well, deeper in.
        top = min((len(path.parts) for path in scenes), default=0)
        self._scenes = [path for path in scenes if len(path.parts) == top]
        if len(self._scenes) != 1:
            raise InputError(f"{place} has {len(self._scenes)} scenes (.mrml) in it: 1 wanted")

    @classmethod
    @contextmanager
    def opened(cls, file: IO[bytes], place: str, budget: _Budget) -> Iterator["_Bundle"]:
        with _whole(place), zipfile.ZipFile(file) as bundle:
            if len(bundle.filelist) > _MAX_MEMBERS:
                raise InputError(
                    f"{place} has {len(bundle.filelist)} files in it: {_MAX_MEMBERS} allowed"
                )
            yield cls(bundle, place, budget)

    def scene(self) -> bytes:
        name = str(self._scenes[0])
        with self._zip.open(name) as file:
            return self.budget.read(file, f"{self.place}: {name}")

    @contextmanager
    def open(self, name: str) -> Iterator[IO[bytes]]:
        member = str(self._scenes[0].parent / name)
        if member not in self._zip.NameToInfo:
            raise InputError(f"{self.place} has no file {member!r}, which a sequence is to be in")
        size = self._zip.getinfo(member).file_size
        if size > self._left_bytes:
            raise InputError(
                f"{self.place}: {member} unpacks to {size} bytes: {self._left_bytes} allowed"
            )
        self._left_bytes -= size
        with _whole(self.place), self._zip.open(member) as file:
            yield file
            while file.read(_CHUNK_BYTES):  # its checksum is compared at the end alone
                pass


@contextmanager
def _whole(place: str) -> Iterator[None]:
    try:
        yield
    except MarginGuardError:
        raise
    except _DAMAGE as error:
        raise InputError(f"{place} is no whole bundle: {error or type(error).__name__}") from error
