"""A mapping of a document as a dataclass, whose fields are annotated with their keys.

    @dataclass(frozen=True, slots=True)
    class Interval:
        start_s: Annotated[float, Number("start", minimum=0.0)]
        max_rad: Annotated[float, Number("largest rotation")]

`block_of` makes the `Block` from which the JSON Schema and the commented YAML come, and `read_as`
reads a value of the class. A field in ns is read from a key in ms, one in rad from a key in
degrees: ``max_rad`` from ``max_deg``. A text in the annotation is the name of another key, a `By`
the function that makes the value, a mapping the keys that belong to the field.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, fields
from functools import partial
from typing import Any, TypeVar, get_type_hints

from app.files.document import Section
from app.files.keys import Block, Key
from app.geometry import NS_PER_MS

_Entry = TypeVar("_Entry")

_CONVERSIONS: tuple[tuple[str, str, Callable[[float], float]], ...] = (
    ("_ns", "_ms", lambda value: round(value * NS_PER_MS)),
    ("_rad", "_deg", math.radians),
    ("_rad_s", "_deg_s", math.radians),
    ("_rad_s2", "_deg_s2", math.radians),
    ("_s", "_ms", lambda value: value / 1000.0),
)
"""Ending of a field, ending of its key, and what turns a value of the key into one of the field."""


@dataclass(frozen=True, slots=True)
class By:
    """The value of a field is ``read`` from the whole mapping."""

    read: Callable[[Section], Any]


def block_of(
    entry: type[Any], description: str, more: Mapping[str, Key] | None = None, **options: Any
) -> Block:
    """Return the block of the keys of ``entry`` and of ``more``; ``options`` are those of `Block`.

    Where another mapping has this block, its value is read as an ``entry``.
    """
    declared = _declared_fields(entry)
    keys: dict[str, Key] = {}
    for each in declared:
        keys |= each.keys
    read = partial(_read, entry, declared)
    return Block(description, keys | dict(more or {}), read=read, **options)


def read_as(entry: type[_Entry], section: Section) -> _Entry:
    """Read an ``entry`` from ``section``, which has its keys; `InputError` for the first fault.

    A missing optional key gives the default of its field, None without one. The rules of several
    keys are those of the method ``check(section)`` of the class, if it has one.
    """
    return _read(entry, _declared_fields(entry), section)


def value_as(section: Section, field: str, key: str = "") -> Any:
    """Return the value of ``key``, by default that of ``field``, in the unit of ``field``.

    None for a missing optional key.
    """
    key = key or _key_name(field)
    value, convert = section.value(key), _conversion(field, key)
    return value if value is None or convert is None else convert(value)


def _read(entry: type[_Entry], declared: "tuple[_DeclaredField, ...]", section: Section) -> _Entry:
    values = {}
    for each in declared:
        value = each.read(section)
        if value is not None or not each.has_default:
            values[each.name] = value
    made = entry(**values)
    check = getattr(made, "check", None)
    if check is not None:
        check(section)
    return made


@dataclass(frozen=True, slots=True)
class _DeclaredField:
    name: str
    keys: Mapping[str, Key]
    read: Callable[[Section], Any]
    has_default: bool


def _declared_fields(entry: type[Any]) -> tuple[_DeclaredField, ...]:
    hints = get_type_hints(entry, include_extras=True)
    found = (
        _declared(each, getattr(hints[each.name], "__metadata__", ())) for each in fields(entry)
    )
    return tuple(each for each in found if each is not None)


def _declared(field: "Field[Any]", metadata: tuple[Any, ...]) -> _DeclaredField | None:
    name = next((each for each in metadata if isinstance(each, str)), _key_name(field.name))
    key = next((each for each in metadata if isinstance(each, Key)), None)
    several = next((each for each in metadata if isinstance(each, Mapping)), None)
    by = next((each for each in metadata if isinstance(each, By)), None)
    if key is None and several is None and by is None:
        return None
    return _DeclaredField(
        field.name,
        {name: key} if key is not None else several or {},
        partial(value_as, field=field.name, key=name) if by is None else by.read,
        field.default is not MISSING or field.default_factory is not MISSING,
    )


def _key_name(field: str) -> str:
    for ending, of_key, _ in _CONVERSIONS[:-1]:
        if field.endswith(ending):
            return field.removesuffix(ending) + of_key
    return field


def _conversion(field: str, key: str) -> Callable[[float], float] | None:
    for ending, of_key, convert in _CONVERSIONS:
        if field.endswith(ending) and key.endswith(of_key):
            return convert
    return None
