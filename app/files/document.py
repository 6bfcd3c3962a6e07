"""A YAML document read strictly: nothing unknown, nothing twice, nothing of the wrong type.

A key that is misspelt in a safety setting must not fall back to anything, so every mapping names
the keys that it allows, and every error names the place (``case.yaml: tool.mesh.unit``).
"""

import math
import re
import reprlib
from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import Any

import yaml

from app.files.bounded_io import read_small
from app.geometry import InputError

MAX_BYTES = 1_000_000
MAX_DEPTH = 16

_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_READ_OTHERWISE = re.compile(r"[_:]|^[-+]?0[0-9xb]")
"""YAML 1.1 reads 1_0 as ten, 1:30 as ninety and 010 as eight."""

_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother = 1, 60, 60


class _StrictLoader(yaml.SafeLoader):
    """A safe loader without double keys, merges and deep nesting.

    Aliases are allowed, since dumpers write them for values that stand twice: they share the value
    and cannot unfold. Merge keys copy, and copies of copies grow without end.
    """

    depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.depth >= MAX_DEPTH:
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise _refused(mark, f"nested deeper than {MAX_DEPTH} levels")
        self.depth += 1
        try:
            node: yaml.Node | None = super().compose_node(parent, index)
        finally:
            self.depth -= 1
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: dict[str, int] = {}
        for key, _ in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode):
                raise _refused(key.start_mark, "a key must be a plain word")
            if key.tag == "tag:yaml.org,2002:merge":
                raise _refused(key.start_mark, "a merge key (<<) is not allowed")
            if key.value in seen:
                raise _refused(
                    key.start_mark,
                    f"key {key.value!r} stands twice, first in line {seen[key.value]}",
                )
            seen[key.value] = line
        return super().construct_mapping(node, deep)

    def construct_scalar(self, node: Any) -> Any:
        if node.tag in _NUMBERS and _READ_OTHERWISE.search(node.value):
            raise _refused(
                node.start_mark,
                f"{node.value[:60]!r} is no number that all read alike: digits wanted",
            )
        return super().construct_scalar(node)


def _refused(mark: yaml.Mark, problem: str) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


class Section:
    """One mapping of a document: typed access by key; anything else is an `InputError`."""

    def __init__(self, values: object, where: str, allowed: Sequence[str]) -> None:
        self._where = where
        if not isinstance(values, dict):
            raise InputError(f"{where} is {_shown(values)}: a mapping wanted")
        for key in values:
            if key not in allowed:
                raise InputError(
                    f"{self.place(key)} is not known: allowed here are {', '.join(allowed)}"
                )
        self._values = values

    @classmethod
    def load(cls, path: Path, allowed: Sequence[str]) -> "Section":
        """The mapping that the YAML file at ``path`` holds."""
        content = read_small(path, MAX_BYTES)
        try:
            values = yaml.load(content.decode("utf-8"), _StrictLoader)
        except UnicodeDecodeError as error:
            raise InputError(f"{path} is not UTF-8 text: byte {error.start}") from error
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark
            line = f" line {mark.line + 1}" if mark else ""
            raise InputError(f"{path}{line}: {error.problem}") from error
        except (yaml.YAMLError, ValueError) as error:
            raise InputError(f"{path} is not YAML: {str(error).splitlines()[0]}") from error
        if values is None:
            raise InputError(f"{path} is empty: a mapping wanted")
        return cls(values, f"{path.name}:", allowed)

    def place(self, key: object) -> str:
        """Where ``key`` of this mapping stands, for messages: ``case.yaml: tool.mesh.unit``."""
        return f"{self._where} {key}" if self._where.endswith(":") else f"{self._where}.{key}"

    def has(self, key: str) -> bool:
        """Whether ``key`` is given, with a value or with null."""
        return key in self._values

    def section(self, key: str, allowed: Sequence[str]) -> "Section":
        """The mapping under ``key``."""
        return Section(self._get(key), self.place(key), allowed)

    def sections(self, key: str, allowed: Sequence[str]) -> tuple["Section", ...]:
        """The list of mappings under ``key``."""
        values = self._list(key)
        return tuple(Section(v, f"{self.place(key)}[{i}]", allowed) for i, v in enumerate(values))

    def text(self, key: str) -> str:
        """A text that is not empty."""
        value = self._get(key)
        if not isinstance(value, str) or not value.strip():
            raise InputError(f"{self.place(key)} is {_shown(value)}: a text wanted")
        return value

    def choice(self, key: str, options: Sequence[str]) -> str:
        """One of ``options``."""
        value = self._get(key)
        if value not in options:
            raise InputError(
                f"{self.place(key)} is {_shown(value)}: one of {', '.join(options)} wanted"
            )
        return str(value)

    def boolean(self, key: str) -> bool:
        """True or false."""
        value = self._get(key)
        if not isinstance(value, bool):
            raise InputError(f"{self.place(key)} is {_shown(value)}: true or false wanted")
        return value

    def integer(self, key: str, *, minimum: int) -> int:
        """A whole number from ``minimum`` on."""
        value = self._get(key)
        if type(value) is not int or value < minimum:
            raise InputError(
                f"{self.place(key)} is {_shown(value)}: a whole number from {minimum} on wanted"
            )
        return value

    def number(self, key: str, *, minimum: float = -math.inf) -> float:
        """A finite number, not below ``minimum``."""
        value = _finite(self._get(key), self.place(key))
        if value < minimum:
            raise InputError(f"{self.place(key)} is {value:g}: at least {minimum:g} wanted")
        return value

    def numbers(self, key: str, count: int) -> tuple[float, ...]:
        """Exactly ``count`` finite numbers."""
        return _row(self._get(key), count, self.place(key))

    def points(self, key: str) -> tuple[tuple[float, ...], ...]:
        """A list of points [x, y, z]."""
        rows = self._list(key)
        return tuple(_row(row, 3, f"{self.place(key)}[{i}]") for i, row in enumerate(rows))

    def _list(self, key: str) -> list[object]:
        value = self._get(key)
        if not isinstance(value, list):
            raise InputError(f"{self.place(key)} is {_shown(value)}: a list wanted")
        return value

    def _get(self, key: str) -> object:
        if key not in self._values:
            raise InputError(f"{self.place(key)} is missing")
        return self._values[key]


def _row(value: object, count: int, where: str) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != count:
        found = f"{len(value)} values" if isinstance(value, list) else _shown(value)
        raise InputError(f"{where} is {found}: a list of {count} numbers wanted")
    return tuple(_finite(entry, f"{where}[{i}]") for i, entry in enumerate(value))


def _finite(value: object, where: str) -> float:
    # YAML 1.1 reads 1e3 without a dot as a text; the message shows the quotes.
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where} is {_shown(value)}: a number wanted (1000.0 or 1.0e+3, not 1e3)")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{where} is {_shown(value)}: a finite number wanted")
    return number


def _shown(value: object) -> str:
    return _SHORT.repr(value)
