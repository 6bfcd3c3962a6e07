"""Typed access to a YAML document: unknown keys and values of a wrong type are errors.

A misspelt key of a safety setting must not fall back to a default. So every mapping is read by a
`Block`, which declares its keys, and every error names the place (``case.yaml: tool.mesh.unit``).
"""

import math
import reprlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

from app.files.keys import (
    Block,
    Boolean,
    Choice,
    Frame,
    Integer,
    Key,
    ListOf,
    Number,
    Numbers,
    Text,
    Texts,
    did_you_mean,
    unit_of,
)
from app.files.yaml_file import load_yaml
from app.geometry import FrameError, InputError, MarginGuardError, Transform, check_frame

_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother = 1, 60, 60

_Declared = TypeVar("_Declared", bound=Key)


class Section:
    """One mapping of a document, with the keys of ``block``.

    Each getter returns the value of a key, or the default that the block declares for it. It raises
    `InputError` for a missing or invalid value, and `TypeError` for a key of another declared type.
    """

    def __init__(self, values: object, where: str, block: Block, folder: Path = Path()) -> None:
        self.where = where
        self.folder = folder
        """Folder in which relative names of files are."""
        self._block = block
        if not isinstance(values, dict):
            raise InputError(f"{where} is {_shown(values)}; expected a mapping")
        notes = []
        for old in [key for key in values if key in block.old_names]:
            new = block.old_names[old]
            if new in values:
                raise InputError(
                    f"{self.place(old)} is the old name of {new}, which is given, too; "
                    f"expected {new} only"
                )
            values = {new if key == old else key: value for key, value in values.items()}
            notes.append(f"{self.place(old)} is the old name of {new}: rename it")
        self.notes = tuple(notes)
        """A sentence about each key that is given by its old name."""
        for key in values:
            if key in block.replaced:
                raise InputError(f"{self.place(key)} is gone; expected {block.replaced[key]}")
            if key not in block.keys:
                raise InputError(
                    f"{self.place(key)} is unknown; expected one of {', '.join(block.keys)}"
                    f"{did_you_mean(key, block.keys)}"
                )
        self._values = values

    @classmethod
    def load(cls, path: Path, block: Block | Callable[[object], Block]) -> "Section":
        """Load the mapping of the YAML file at ``path``; ``block`` may depend on its values."""
        values = load_yaml(path)
        if values is None:
            raise InputError(f"{path} is empty; expected a mapping")
        chosen = block if isinstance(block, Block) else block(values)
        return cls(values, f"{path.name}:", chosen, path.parent)

    def place(self, key: object) -> str:
        """Return the place of ``key`` for messages: ``case.yaml: tool.mesh.unit``."""
        return f"{self.where} {key}" if self.where.endswith(":") else f"{self.where}.{key}"

    def __contains__(self, key: str) -> bool:
        """True if ``key`` is given, with a value or with null."""
        return key in self._values

    def require(self, keys: Iterable[str]) -> None:
        """Raise `InputError` for the first of ``keys`` that is missing."""
        for key in keys:
            if key not in self:
                raise self._missing(key)

    def value(self, key: str) -> Any:
        """Return the value under ``key`` by its declaration; None for a missing optional key."""
        declared = self._block.keys[key]
        if declared.optional and declared.default is None and key not in self:
            return None
        match declared:
            case Block(read=read):
                section = self.section(key)
                return section if read is None else read(section)
            case ListOf(items=Block(read=read)):
                sections = self.sections(key)
                return sections if read is None else tuple(map(read, sections))
            case ListOf(items=Text()):
                return self.texts(key)
        return _GETTERS[type(declared)](self, key)

    def section(self, key: str) -> "Section":
        """Return the mapping under ``key``."""
        block = self._declared(key, Block)
        return Section(self._get(key), self.place(key), block, self.folder)

    def sections(self, key: str) -> tuple["Section", ...]:
        """Return the list of mappings under ``key``."""
        values, items = self._list(key, Block)
        return tuple(
            Section(each, f"{self.place(key)}[{index}]", items, self.folder)
            for index, each in enumerate(values)
        )

    def text(self, key: str) -> str:
        """Return the text under ``key``, which is not empty."""
        declared = self._declared(key, Text)
        value = self._any_text(key)
        if declared.pattern is not None and not declared.pattern.fullmatch(value):
            raise self._refused(key, value, declared.expected)
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """Return the list of texts under ``key``, which match their declared pattern."""
        values, item = self._list(key, Text)
        for index, value in enumerate(values):
            is_text = isinstance(value, str) and bool(value.strip())
            if not is_text or (item.pattern and not item.pattern.fullmatch(str(value))):
                raise self._refused(f"{key}[{index}]", value, item.expected)
        return tuple(map(str, values))

    def texts_by_name(self, key: str) -> dict[str, str]:
        """Return the mapping of names to texts under ``key``."""
        declared = self._declared(key, Texts)
        values = self._get(key)
        if not isinstance(values, dict):
            raise self._refused(key, values, "a mapping")
        texts = {}
        for name, value in values.items():
            if not isinstance(name, str) or not declared.name.fullmatch(name):
                raise InputError(
                    f"{self.place(key)} has the name {_shown(name)}; "
                    f"expected {declared.name_expected}"
                )
            texts[name] = self._plain_text(f"{key}.{name}", value, declared.plain_values)
        return texts

    def _plain_text(self, key: str, value: object, plain_values: bool) -> str:
        if isinstance(value, str) and value.strip():
            return value
        if not plain_values:
            raise self._refused(key, value, "a text")
        if isinstance(value, bool):
            return str(value).lower()
        if isinstance(value, int | float):
            _finite(value, self.place(key))
            return str(value)
        raise self._refused(key, value, "a text, a number, true or false")

    def frame(self, key: str) -> str:
        """Return the name of a frame under ``key``."""
        self._declared(key, Frame)
        name = self._any_text(key)
        try:
            return check_frame(name)
        except FrameError as error:
            raise InputError(f"{self.place(key)}: {error}") from error

    def choice(self, key: str) -> str:
        """Return the value under ``key``, which is one of its options."""
        options = self._declared(key, Choice).options
        value = self._get(key)
        if value not in options:
            raise self._refused(key, value, f"one of {', '.join(options)}")
        return str(value)

    def boolean(self, key: str) -> bool:
        """Return the boolean under ``key``."""
        self._declared(key, Boolean)
        value = self._get(key)
        if not isinstance(value, bool):
            raise self._refused(key, value, "true or false")
        return value

    def integer(self, key: str) -> int:
        """Return the integer under ``key``, which is within its bounds."""
        declared = self._declared(key, Integer)
        value, low, high = self._get(key), declared.minimum, declared.maximum
        if type(value) is not int or value < low:
            raise self._refused(key, value, f"an integer of at least {low}")
        if high is not None and value > high:
            raise self._refused(key, value, f"{low} to {high}" if low < high else f"{low}")
        return value

    def number(self, key: str) -> float:
        """Return the finite number under ``key``, which is within its bounds."""
        declared = self._declared(key, Number)
        value = _finite(self._get(key), self.place(key))
        if not (declared.minimum <= value <= declared.maximum and value > declared.above):
            raise InputError(f"{self.place(key)} is {value:g}; expected {_range(key, declared)}")
        return value

    def numbers(self, key: str) -> tuple[float, ...]:
        """Return the list of finite numbers under ``key``, which has its declared length."""
        return _row(self._get(key), self._declared(key, Numbers).count, self.place(key))

    def matrix(self, key: str, *, target: str, source: str) -> Transform:
        """Return 16 numbers under ``key`` as ``target_from_source``, which is rigid."""
        numbers = self.numbers(key)
        try:
            return Transform.from_matrix(numbers, target=target, source=source)
        except MarginGuardError as error:
            raise InputError(f"{self.place(key)}: {error}") from error

    def points(self, key: str) -> tuple[tuple[float, ...], ...]:
        """Return the list of points [x, y, z] under ``key``."""
        rows, point = self._list(key, Numbers)
        return tuple(
            _row(row, point.count, f"{self.place(key)}[{i}]") for i, row in enumerate(rows)
        )

    def _any_text(self, key: str) -> str:
        value = self._get(key)
        if not isinstance(value, str) or not value.strip():
            raise self._refused(key, value, "a text")
        return value

    def _list(self, key: str, kind: type[_Declared]) -> tuple[list[object], _Declared]:
        """Return the list under ``key`` and the declaration, of type ``kind``, of its items."""
        declared = self._declared(key, ListOf)
        value = self._get(key)
        if not isinstance(value, list):
            raise self._refused(key, value, "a list")
        if declared.if_empty and not value:
            raise InputError(f"{self.place(key)} is empty; {declared.if_empty}")
        return value, _of_kind(declared.items, kind, key)

    def _get(self, key: str) -> object:
        if key in self._values:
            return self._values[key]
        default = self._block.keys[key].default
        if default is None:
            raise self._missing(key)
        return default

    def _missing(self, key: str) -> InputError:
        expected = self._block.keys[key].description.partition(";")[0]
        return InputError(f"{self.place(key)} is missing; expected {expected}")

    def _declared(self, key: str, kind: type[_Declared]) -> _Declared:
        return _of_kind(self._block.keys[key], kind, key)

    def _refused(self, key: str, value: object, expected: str) -> InputError:
        return InputError(f"{self.place(key)} is {_shown(value)}; expected {expected}")


_GETTERS: dict[type[Key], Callable[[Section, str], Any]] = {
    Text: Section.text,
    Texts: Section.texts_by_name,
    Frame: Section.frame,
    Choice: Section.choice,
    Boolean: Section.boolean,
    Integer: Section.integer,
    Number: Section.number,
    Numbers: Section.numbers,
    ListOf: Section.points,
}


def _of_kind(declared: Key, kind: type[_Declared], key: str) -> _Declared:
    if not isinstance(declared, kind):
        raise TypeError(f"{key} is declared as {type(declared).__name__}, not {kind.__name__}")
    return declared


def _range(key: str, declared: Number) -> str:
    above, high = declared.above, declared.maximum
    low = f"{declared.minimum}" if math.isinf(above) else f"more than {above:g}"
    if math.isinf(high):
        return low if math.isfinite(above) else f"at least {declared.minimum:g}"
    if low == "-inf":
        return f"at most {high:g}"
    return f"{low} to {high} {unit_of(key)}".rstrip()


def _row(value: object, count: int, where: str) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != count:
        found = f"{len(value)} values" if isinstance(value, list) else _shown(value)
        raise InputError(f"{where} is {found}; expected a list of {count} numbers")
    return tuple(_finite(entry, f"{where}[{i}]") for i, entry in enumerate(value))


def _finite(value: object, where: str) -> float:
    # YAML 1.1 reads 1e3, which has no dot, as text.
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(
            f"{where} is {_shown(value)}; expected a number (1000.0 or 1.0e+3, not 1e3)"
        )
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{where} is {_shown(value)}; expected a finite number")
    return number


def _shown(value: object) -> str:
    return _SHORT.repr(value)
