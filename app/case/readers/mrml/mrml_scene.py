"""An MRML scene: its files, and its sequences of transforms and its plain transforms.

The files are in the scene's folder, or in its bundle, which is not unpacked to disk. Not by 3D
Slicer, which only `app.scene` may load and which opens every file that a scene names.
"""

import re
import zipfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import IO, Protocol
from urllib.parse import unquote

from app.files.bounded_io import open_for_reading
from app.files.paths import resolve_inside
from app.files.xml_guard import walk_xml
from app.files.zip_folder import DAMAGE
from app.geometry import InputError, MarginGuardError

_TRANSFORM_NODES = ("vtkMRMLLinearTransformNode", "vtkMRMLTransformNode")
_TRANSFORM_TAGS = ("LinearTransform", "Transform")
_STORAGE_ENDINGS = ("SequenceStorage", "TransformStorage")
_NODE_NUMBER = re.compile(r"\d+$")
_ITEM = re.compile("[^;]+")
_MAX_ITEMS = 2_000_000
_MAX_SEQUENCES = 256
_LOST = "MarginGuard.Lost"
_DERIVED = "MarginGuard.Derived"


@dataclass(frozen=True, slots=True)
class SequenceEntry:
    """A sequence of transforms over time.

    ``name``: the transform's name if the scene has it, else the sequence's, which may be empty.
    ``file_name``: relative to the scene; empty if the scene itself has the items, as in a
    ``.seq.mrb``. ``index``: text of item IDs and their times in s, for `index_items`. ``lost``:
    times in s and statuses of samples that the sequence does not hold.
    """

    name: str
    file_name: str
    index: str
    lost: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class TransformEntry:
    """A linear transform node: its matrix to the parent as text of 16 numbers, and its status.

    Without a ``matrix`` the numbers are in the file ``file_name``, relative to the scene.
    """

    matrix: str
    status: str
    name: str = ""
    file_name: str = ""


@dataclass(slots=True)
class MrmlDocument:
    """Sequences of transforms, transforms by node ID, and classes of other sequences of a scene."""

    sequences: list[SequenceEntry] = field(default_factory=list)
    transforms: dict[str, TransformEntry] = field(default_factory=dict)
    other_classes: tuple[str, ...] = ()


class ItemLimit:
    """Limit of the elements, index items and attributes in all scenes of one recording."""

    def __init__(self) -> None:
        self._left = _MAX_ITEMS

    def count(self, items: int, where: str) -> None:
        """Count ``items`` more; `InputError` beyond the limit."""
        self._left -= items
        if self._left < 0:
            raise InputError(
                f"{where}: the scenes of a recording have more than {_MAX_ITEMS} elements and "
                f"items of sequences; expected {_MAX_ITEMS} or fewer"
            )


def read_mrml_document(content: bytes, where: str, limit: ItemLimit) -> MrmlDocument:
    """Parse an MRML scene file; ``where`` names it in messages, ``limit`` counts its items.

    Sequences that were computed from measured ones and those of other nodes are left out. Raises
    `InputError` for text that is not MRML, for a document type, and for a sequence of transforms
    that is not over time in seconds or has no file.
    """
    scene = _Parser(where, limit)
    walk_xml(content, where, start=scene.start)
    return scene.document()


def index_items(index: str, where: str) -> Iterator[tuple[str, str]]:
    """Yield item IDs and times in s of `SequenceEntry.index`."""
    for match in _ITEM.finditer(index):
        yield _split(match[0], ":", where)


@dataclass(slots=True)
class _Parser:
    where: str
    limit: ItemLimit
    is_mrml: bool = False
    storages: dict[str, str] = field(default_factory=dict)
    sequences: list[dict[str, str]] = field(default_factory=list)
    transforms: dict[str, TransformEntry] = field(default_factory=dict)

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.limit.count(1, self.where)
        if not self.is_mrml:
            if tag != "MRML":
                raise InputError(f"{self.where} is a {tag[:60]!r}; expected an MRML scene")
            self.is_mrml = True
        identity = attributes.get("id", "")
        if tag == "Sequence":
            self.sequences.append(attributes)
        elif tag.endswith(_STORAGE_ENDINGS):
            self.storages[identity] = unquote(attributes.get("fileName", ""))
        elif tag in _TRANSFORM_TAGS:
            self.transforms[identity] = self._transform(attributes)

    def document(self) -> MrmlDocument:
        if len(self.sequences) > _MAX_SEQUENCES:
            raise InputError(
                f"{self.where} has {len(self.sequences)} sequences; "
                f"expected {_MAX_SEQUENCES} or fewer"
            )
        entries = [self._entry(attributes) for attributes in self.sequences]
        # A storage may come after the node that names it.
        transforms = {
            identity: replace(entry, file_name=self.storages.get(entry.file_name, ""))
            for identity, entry in self.transforms.items()
        }
        others = dict.fromkeys(each for each in map(self._class_of, self.sequences) if each)
        return MrmlDocument(
            [entry for entry in entries if entry is not None],
            transforms,
            tuple(name for name in others if name not in _TRANSFORM_NODES),
        )

    def _transform(self, node: dict[str, str]) -> TransformEntry:
        """A transform, with the ID of its storage in place of the name of its file."""
        status = self._pairs(node.get("attributes", "")).get("TransformStatus", "OK")
        storage = self._pairs(node.get("references", "")).get("storage", "")
        return TransformEntry(
            node.get("matrixTransformToParent", ""),
            status,
            node.get("name", ""),
            storage or node.get("storageNodeRef", ""),
        )

    def _class_of(self, node: dict[str, str]) -> str:
        """Class of the items of a sequence; Slicer 4.4 gives it in their IDs only."""
        known = self._pairs(node.get("attributes", "")).get("DataNodeClassName", "")
        first = unquote(node.get("indexValues", "").partition(":")[0])
        if not known and first in self.transforms:
            return _TRANSFORM_NODES[0]
        return known or _NODE_NUMBER.sub("", first)

    def _entry(self, node: dict[str, str]) -> SequenceEntry | None:
        known = self._pairs(node.get("attributes", ""))
        if self._class_of(node) not in _TRANSFORM_NODES or _DERIVED in known:
            return None
        name = node.get("name", "")
        where = f"{self.where}: sequence {name!r}"
        over = (
            node.get("indexName", ""),
            node.get("indexUnit", ""),
            node.get("indexType", "numeric"),
        )
        if over != ("time", "s", "numeric"):
            raise InputError(
                f"{where} is over {over[0]!r} in {over[1]!r} ({over[2]}); expected time in 's'"
            )
        storage = self._pairs(node.get("references", "")).get("storage", "")
        storage = storage or node.get("storageNodeRef", "")
        index = self._counted(node.get("indexValues", ""), ";")
        first = unquote(index.partition(":")[0])
        if not self.storages.get(storage) and first not in self.transforms:
            raise InputError(f"{where} has no file: storage {storage!r} is not in the scene")
        lost = known.get(_LOST, "")
        return SequenceEntry(
            known.get("Sequences.Source") or name,
            self.storages.get(storage, ""),
            index,
            tuple(_split(item, "=", where) for item in self._counted(lost, "=").split()),
        )

    def _counted(self, text: str, separator: str) -> str:
        self.limit.count(text.count(separator), self.where)
        return text

    def _pairs(self, text: str) -> dict[str, str]:
        """Parse ``name:value;name:value``; separators within either are percent-encoded."""
        pairs = (item.partition(":") for item in self._counted(text, ";").split(";") if item)
        return {unquote(name): unquote(value) for name, _, value in pairs}


def _split(item: str, at: str, where: str) -> tuple[str, str]:
    left, found, right = item.partition(at)
    if not found:
        raise InputError(f"{where}: {item[:60]!r} is not a pair; expected {at!r} between its parts")
    return unquote(left), unquote(right)


_MAX_SCENE_BYTES = 128_000_000
"""Limit on all scenes of one recording together: the sequences of a scene are read side by side."""
_MAX_RATIO = 256
_FREE_BYTES = 16_000_000
"""All files of sequences in one bundle unpack to `_MAX_RATIO` times its size, and this, at most."""
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Compression of bundles of 3D Slicer; `zipfile` unpacks the others without a limit."""
_MAX_MEMBERS = 20_000
_CHUNK_BYTES = 1_000_000


class _Budget:
    """Bytes that may still be read into memory for the scenes of one recording."""

    def __init__(self) -> None:
        self._left_bytes = _MAX_SCENE_BYTES

    def read(self, file: IO[bytes], where: str) -> bytes:
        """Read all of ``file``; `InputError` where it exceeds the budget."""
        content = file.read(self._left_bytes + 1)
        if len(content) > self._left_bytes:
            raise InputError(
                f"{where}: the scenes of a recording are too large; expected "
                f"{_MAX_SCENE_BYTES} bytes or less"
            )
        self._left_bytes -= len(content)
        return content


class MrmlFiles(Protocol):
    """A scene file and the files that it names; ``where`` names it in messages."""

    where: str
    budget: _Budget

    def scene(self) -> bytes:
        """Read the scene itself."""
        ...

    def open(self, name: str) -> AbstractContextManager[IO[bytes]]:
        """Open a file that the scene names."""
        ...


@contextmanager
def open_mrml(path: Path) -> Iterator[MrmlFiles]:
    """Open the scene at ``path``; `InputError` where it cannot be read or is damaged."""
    if path.suffix.lower() == ".mrb":
        with (
            open_for_reading(path) as file,
            _Bundle.opened(file, str(path), _Budget()) as bundle,
        ):
            yield bundle
    else:
        yield _Folder(path)


@contextmanager
def open_inner(files: MrmlFiles, file: IO[bytes], name: str, where: str) -> Iterator[MrmlFiles]:
    """Open the scene in ``file``, ``name`` of ``files``; by its ending a scene or a bundle."""
    content = files.budget.read(file, where)
    if name.lower().endswith(".mrb"):
        with _Bundle.opened(BytesIO(content), where, files.budget) as bundle:
            yield bundle
    else:
        yield _Inner(files, content, PurePosixPath(name).parent, where)


class _Inner:
    """A scene that is a file of another scene, in whose folder its own files are."""

    def __init__(self, files: MrmlFiles, content: bytes, folder: PurePosixPath, where: str) -> None:
        self.where = where
        self.budget = files.budget
        self._files, self._content, self._folder = files, content, folder

    def scene(self) -> bytes:
        return self._content

    def open(self, name: str) -> AbstractContextManager[IO[bytes]]:
        return self._files.open(str(self._folder / name))


class _Folder:
    """An ``.mrml`` file; the files that it names may not be outside its folder."""

    def __init__(self, path: Path) -> None:
        self.where = str(path)
        self.budget = _Budget()
        self._path = path

    def scene(self) -> bytes:
        with open_for_reading(self._path) as file:
            return self.budget.read(file, self.where)

    @contextmanager
    def open(self, name: str) -> Iterator[IO[bytes]]:
        path = resolve_inside(self._path.parent, name, f"{self.where}: the file of a sequence")
        with open_for_reading(path) as file:
            yield file


class _Bundle:
    """A ZIP file with one scene; its members are streamed and never unpacked to disk."""

    def __init__(self, bundle: zipfile.ZipFile, where: str, budget: _Budget, size: int) -> None:
        self.where = where
        self.budget = budget
        self._zip = bundle
        self._left_bytes = _FREE_BYTES + _MAX_RATIO * size
        names = bundle.namelist()
        scenes = [PurePosixPath(name) for name in names if name.lower().endswith(".mrml")]
        # A sequence may be an .mrml file too, in a deeper folder.
        top = min((len(path.parts) for path in scenes), default=0)
        self._scenes = [path for path in scenes if len(path.parts) == top]
        if len(self._scenes) != 1:
            raise InputError(f"{where} has {len(self._scenes)} scenes (.mrml); expected 1")

    @classmethod
    @contextmanager
    def opened(cls, file: IO[bytes], where: str, budget: _Budget) -> Iterator["_Bundle"]:
        with _damage_reported(where), zipfile.ZipFile(file) as bundle:
            if len(bundle.filelist) > _MAX_MEMBERS:
                raise InputError(
                    f"{where} has {len(bundle.filelist)} files; expected {_MAX_MEMBERS} or less"
                )
            methods = {info.compress_type for info in bundle.filelist}
            if not methods <= set(_METHODS):
                raise InputError(f"{where} holds files that are not deflated; expected a .mrb file")
            yield cls(bundle, where, budget, file.seek(0, 2))

    def scene(self) -> bytes:
        name = str(self._scenes[0])
        with self._zip.open(name) as file:
            return self.budget.read(file, f"{self.where}: {name}")

    @contextmanager
    def open(self, name: str) -> Iterator[IO[bytes]]:
        member = str(self._scenes[0].parent / name)
        if member not in self._zip.NameToInfo:
            raise InputError(f"{self.where} has no file {member!r}, which holds a sequence")
        size = self._zip.getinfo(member).file_size
        if size > self._left_bytes:
            raise InputError(
                f"{self.where}: {member} unpacks to {size} bytes; "
                f"expected {self._left_bytes} or less"
            )
        self._left_bytes -= size
        with _damage_reported(self.where), self._zip.open(member) as file:
            yield file
            while file.read(_CHUNK_BYTES):  # zipfile compares the checksum at the end only
                pass


@contextmanager
def _damage_reported(where: str) -> Iterator[None]:
    try:
        yield
    except MarginGuardError:
        raise
    except DAMAGE as error:
        raise InputError(
            f"{where} is not a complete bundle: {error or type(error).__name__}"
        ) from error
