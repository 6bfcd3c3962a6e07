"""Parses an MRML scene file for its sequences of transforms and its plain transforms."""

from dataclasses import dataclass, field
from urllib.parse import unquote

from app.files.xml_guard import walk_xml
from app.geometry import InputError

_TRANSFORM_NODES = ("vtkMRMLLinearTransformNode", "vtkMRMLTransformNode")
_TRANSFORM_TAGS = ("LinearTransform", "Transform")
_STORAGE_ENDING = "SequenceStorage"
_LOST = "MarginGuard.Lost"
_DERIVED = "MarginGuard.Derived"


@dataclass(frozen=True, slots=True)
class SequenceEntry:
    """A sequence of transforms over time.

    ``name``: the transform's name if the scene has it, else the sequence's. ``file_name``: relative
    to the scene. ``index``: item IDs and their times in s, in order. ``lost``: times in s and
    statuses of samples that the sequence does not hold.
    """

    name: str
    file_name: str
    index: tuple[tuple[str, str], ...]
    lost: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class TransformEntry:
    """A linear transform node: its matrix to the parent as text of 16 numbers, and its status."""

    matrix: str
    status: str


@dataclass(slots=True)
class MrmlDocument:
    """Sequences and transforms, by node ID, of one scene file."""

    sequences: list[SequenceEntry] = field(default_factory=list)
    transforms: dict[str, TransformEntry] = field(default_factory=dict)


def read_mrml_document(content: bytes, where: str) -> MrmlDocument:
    """Parse an MRML scene file; ``where`` names it in messages.

    Sequences that were computed from measured ones and those of other nodes are left out. Raises
    `InputError` for text that is not MRML, for a document type, and for a sequence of transforms
    that is not over time in seconds or has no file.
    """
    scene = _Parser(where)
    walk_xml(content, where, start=scene.start)
    return scene.document()


@dataclass(slots=True)
class _Parser:
    where: str
    is_mrml: bool = False
    storages: dict[str, str] = field(default_factory=dict)
    sequences: list[dict[str, str]] = field(default_factory=list)
    transforms: dict[str, TransformEntry] = field(default_factory=dict)

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if not self.is_mrml:
            if tag != "MRML":
                raise InputError(f"{self.where} is a {tag[:60]!r}; expected an MRML scene")
            self.is_mrml = True
        identity = attributes.get("id", "")
        if tag == "Sequence":
            self.sequences.append(attributes)
        elif tag.endswith(_STORAGE_ENDING):
            self.storages[identity] = unquote(attributes.get("fileName", ""))
        elif tag in _TRANSFORM_TAGS:
            status = _pairs(attributes.get("attributes", "")).get("TransformStatus", "OK")
            matrix = attributes.get("matrixTransformToParent", "")
            self.transforms[identity] = TransformEntry(matrix, status)

    def document(self) -> MrmlDocument:
        entries = [self._entry(attributes) for attributes in self.sequences]
        return MrmlDocument([entry for entry in entries if entry is not None], self.transforms)

    def _entry(self, node: dict[str, str]) -> SequenceEntry | None:
        known = _pairs(node.get("attributes", ""))
        if known.get("DataNodeClassName") not in _TRANSFORM_NODES or _DERIVED in known:
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
        storage = _pairs(node.get("references", "")).get("storage", "")
        if not self.storages.get(storage):
            raise InputError(f"{where} has no file: storage {storage!r} is not in the scene")
        return SequenceEntry(
            known.get("Sequences.Source") or name,
            self.storages[storage],
            tuple(_split(item, ":", where) for item in _items(node.get("indexValues", ""))),
            tuple(_split(item, "=", where) for item in known.get(_LOST, "").split()),
        )


def _items(text: str) -> list[str]:
    return [item for item in text.split(";") if item]


def _pairs(text: str) -> dict[str, str]:
    """Parse ``name:value;name:value``; separators within a name or value are percent-encoded."""
    pairs = (item.partition(":") for item in _items(text))
    return {unquote(name): unquote(value) for name, _, value in pairs}


def _split(item: str, at: str, where: str) -> tuple[str, str]:
    left, found, right = item.partition(at)
    if not found:
        raise InputError(f"{where}: {item[:60]!r} is not a pair; expected {at!r} between its parts")
    return unquote(left), unquote(right)
