"""Typed access to a YAML document: unknown keys and values of a wrong type are errors.

A misspelt key of a safety setting must not fall back to a default. So every mapping lists the keys
that it allows, and every error names the place (``case.yaml: tool.mesh.unit``).
"""

import math
import reprlib
from collections.abc import Sequence
from pathlib import Path

from app.files.yaml_file import load_yaml
from app.geometry import InputError

_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother = 1, 60, 60


class Section:
    """One mapping of a document. Each getter returns a value of its type or raises `InputError`."""

    def __init__(self, values: object, where: str, allowed: Sequence[str]) -> None:
        self._where = where
        if not isinstance(values, dict):
            raise InputError(f"{where} is {_shown(values)}; expected a mapping")
        for key in values:
            if key not in allowed:
                raise InputError(
                    f"{self.place(key)} is unknown; expected one of {', '.join(allowed)}"
                )
        self._values = values

    @classmethod
    def load(cls, path: Path, allowed: Sequence[str]) -> "Section":
        """Load the mapping of the YAML file at ``path``."""
        values = load_yaml(path)
        if values is None:
            raise InputError(f"{path} is empty; expected a mapping")
        return cls(values, f"{path.name}:", allowed)

    def place(self, key: object) -> str:
        """Return the place of ``key`` for messages: ``case.yaml: tool.mesh.unit``."""
        return f"{self._where} {key}" if self._where.endswith(":") else f"{self._where}.{key}"

    def __contains__(self, key: str) -> bool:
        """True if ``key`` is given, with a value or with null."""
        return key in self._values

    def section(self, key: str, allowed: Sequence[str]) -> "Section":
        """Return the mapping under ``key``."""
        return Section(self._get(key), self.place(key), allowed)

    def sections(self, key: str, allowed: Sequence[str]) -> tuple["Section", ...]:
        """Return the list of mappings under ``key``."""
        values = self._list(key)
        return tuple(Section(v, f"{self.place(key)}[{i}]", allowed) for i, v in enumerate(values))

    def text(self, key: str) -> str:
        """Return the text under ``key``, which is not empty."""
        value = self._get(key)
        if not isinstance(value, str) or not value.strip():
            raise InputError(f"{self.place(key)} is {_shown(value)}; expected a text")
        return value

    def choice(self, key: str, options: Sequence[str]) -> str:
        """Return the value under ``key``, which is one of ``options``."""
        value = self._get(key)
        if value not in options:
            raise InputError(
                f"{self.place(key)} is {_shown(value)}; expected one of {', '.join(options)}"
            )
        return str(value)

    def boolean(self, key: str) -> bool:
        """Return the boolean under ``key``."""
        value = self._get(key)
        if not isinstance(value, bool):
            raise InputError(f"{self.place(key)} is {_shown(value)}; expected true or false")
        return value

    def integer(self, key: str, *, minimum: int) -> int:
        """Return the integer under ``key``, which is at least ``minimum``."""
        value = self._get(key)
        if type(value) is not int or value < minimum:
            raise InputError(
                f"{self.place(key)} is {_shown(value)}; expected an integer of at least {minimum}"
            )
        return value

    def number(self, key: str, *, minimum: float = -math.inf) -> float:
        """Return the finite number under ``key``, which is at least ``minimum``."""
        value = _finite(self._get(key), self.place(key))
        if value < minimum:
            raise InputError(f"{self.place(key)} is {value:g}; expected at least {minimum:g}")
        return value

    def numbers(self, key: str, count: int) -> tuple[float, ...]:
        """Return the list of ``count`` finite numbers under ``key``."""
        return _row(self._get(key), count, self.place(key))

    def points(self, key: str) -> tuple[tuple[float, ...], ...]:
        """Return the list of points [x, y, z] under ``key``."""
        rows = self._list(key)
        return tuple(_row(row, 3, f"{self.place(key)}[{i}]") for i, row in enumerate(rows))

    def _list(self, key: str) -> list[object]:
        value = self._get(key)
        if not isinstance(value, list):
            raise InputError(f"{self.place(key)} is {_shown(value)}; expected a list")
        return value

    def _get(self, key: str) -> object:
        if key not in self._values:
            raise InputError(f"{self.place(key)} is missing")
        return self._values[key]


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
