"""Messages of any installed type to plain values, and back, in our units.

======================= ==========================================================
in a message            here
======================= ==========================================================
message                 dict of its fields
bool, integer, string   the same
float                   float, in the unit that `app.bridge.convert.units` gives it
octet, octet[]          int, bytes
bool[], numbers[]       numpy array (n,); float64 where it was scaled, read-only
strings[], messages[]   list
======================= ==========================================================

Going back every value is checked against its field. rclpy checks nothing unless told so, and sends
an integer in a float field as another number: ``Float64(data=1)`` arrives as 5e-324.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractType,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

from app.bridge.convert.errors import ConversionError
from app.bridge.convert.fields import (
    NUMBERS,
    FieldCodec,
    SizeCheck,
    basic_way,
    bytes_way,
    closed,
    numbers_way,
    shown,
    string_way,
)
from app.bridge.convert.types import message_type, type_name
from app.bridge.convert.units import SCALES, Scale

Plain = dict[str, Any]


def to_plain(message: Any) -> Plain:
    """The fields of ``message`` as plain values, lengths in mm.

    Numpy arrays that were not scaled look into the message: do not change it afterwards.
    """
    plain: Plain = _message_way(message.__class__, None).read(message)
    return plain


def from_plain(kind: str | type, values: Mapping[str, Any]) -> Any:
    """A message of ``kind``, a class or a name; fields that are not given keep their first values.

    Raises `ConversionError`, which names the field, for a value that does not fit, and
    `UnknownTypeError`.
    """
    found = message_type(kind) if isinstance(kind, str) else kind
    return _message_way(found, None).write(values, found.__name__)


@cache
def _message_way(kind: Any, forced: float | None) -> FieldCodec:
    """``forced`` is the scale of all numbers within, when the holder of the message says one."""
    table = SCALES.get(type_name(kind), {})
    ways: dict[str, FieldCodec] = {}
    for field, slot in zip(
        kind.get_fields_and_field_types(),
        kind.SLOT_TYPES,
        strict=True,
    ):
        scale = table.get(field) if forced is None else forced
        ways[field] = _way(slot, scale)

    def read(message: Any) -> Plain:
        return {field: way.read(getattr(message, field)) for field, way in ways.items()}

    def write(values: Any, name: str) -> Any:
        if isinstance(values, kind):
            values = read(values)
        if not isinstance(values, Mapping):
            raise ConversionError(f"{name} is {shown(values)}: a mapping of its fields wanted")
        message = kind()
        for field, value in values.items():
            way = ways.get(field)
            if way is None:
                raise ConversionError(f"{name} has no field {field!r}: {', '.join(ways)}")
            setattr(message, field, way.write(value, f"{name}.{field}"))
        return message

    return FieldCodec(read, write)


def _way(slot: AbstractType, scale: Scale | None) -> FieldCodec:
    if isinstance(slot, NamespacedType):
        if isinstance(scale, tuple):
            raise ConversionError(f"units of {slot.name}: one number wanted for a message")
        return _message_way(getattr(import_module(".".join(slot.namespaces)), slot.name), scale)
    if isinstance(slot, AbstractNestedType):
        return _sequence_way(slot, scale)
    if isinstance(slot, BasicType):
        return basic_way(slot.typename, scale)
    return string_way(slot)


def _sequence_way(slot: AbstractNestedType, scale: Scale | None) -> FieldCodec:
    item = slot.value_type
    check = _size_check(slot)
    if isinstance(item, BasicType) and item.typename in NUMBERS:
        return numbers_way(item.typename, check, scale, fixed=isinstance(slot, Array))
    if isinstance(item, BasicType) and item.typename == "octet":
        return bytes_way(check)
    way = _way(item, scale)

    def write(values: Any, name: str) -> list[Any]:
        if isinstance(values, str | bytes | Mapping) or not isinstance(
            values, Sequence | np.ndarray
        ):
            raise ConversionError(f"{name} is {shown(values)}: a list wanted")
        check(len(values), name)
        return [way.write(value, f"{name}[{index}]") for index, value in enumerate(values)]

    if isinstance(item, BasicType):
        return FieldCodec(read=lambda values: closed(np.array(values, dtype=bool)), write=write)
    return FieldCodec(read=lambda values: [way.read(value) for value in values], write=write)


def _size_check(slot: AbstractNestedType) -> SizeCheck:
    fixed = slot.size if isinstance(slot, Array) else None
    most = slot.maximum_size if isinstance(slot, BoundedSequence) else None

    def check(count: int, name: str) -> None:
        if fixed is not None and count != fixed:
            raise ConversionError(f"{name} has {count} values: {fixed} wanted")
        if most is not None and count > most:
            raise ConversionError(f"{name} has {count} values: {most} at most wanted")

    return check
