"""How each kind of field is read out of a message and, checked, put into one."""

import math
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosidl_parser.definition import AbstractType, AbstractWString

from app.bridge.convert.errors import ConversionError
from app.bridge.convert.units import Scale

NUMBERS = {
    # name: code of array.array and of numpy
    "float": "f",
    "double": "d",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
}
_FLOATS = ("float", "double")
_LARGEST_FLOAT32 = float(np.finfo(np.float32).max)

SizeCheck = Callable[[int, str], None]
"""Raises `ConversionError` when a field of that name may not have so many values."""


@dataclass(frozen=True, slots=True)
class FieldCodec:
    """From a field's value to a plain one; and back, with the field's name for words."""

    read: Callable[[Any], Any]
    write: Callable[[Any, str], Any]


def basic_way(kind: str, scale: Scale | None) -> FieldCodec:
    """A single number, truth value or byte."""
    if kind in _FLOATS:
        factor = scale if isinstance(scale, float) else 1.0
        return FieldCodec(
            read=lambda value: value * factor,
            write=lambda value, name: _float(value, name, factor, kind),
        )
    if kind == "boolean":
        return FieldCodec(read=bool, write=_bool)
    if kind == "octet":
        return FieldCodec(
            read=lambda value: value[0],
            write=lambda value, name: bytes([_integer(value, name, 0, 255)]),
        )
    if kind in NUMBERS:
        limits = np.iinfo(NUMBERS[kind])
        low, high = int(limits.min), int(limits.max)
        return FieldCodec(read=int, write=lambda value, name: _integer(value, name, low, high))
    raise ConversionError(f"a field of type {kind} cannot be converted")


def string_way(slot: AbstractType) -> FieldCodec:
    """A string, as long as it may be, that its encoding can say."""
    most = slot.maximum_size if slot.has_maximum_size() else None
    encoding = "utf-16-le" if isinstance(slot, AbstractWString) else "utf-8"

    def write(value: Any, name: str) -> str:
        if not isinstance(value, str):
            raise ConversionError(f"{name} is {shown(value)}: a string wanted")
        if most is not None and len(value) > most:
            raise ConversionError(f"{name} has {len(value)} characters: {most} at most wanted")
        try:
            value.encode(encoding)
        except UnicodeEncodeError as error:
            raise ConversionError(f"{name} is {shown(value)}: no text in {encoding}") from error
        return value

    return FieldCodec(read=str, write=write)


def bytes_way(check: SizeCheck) -> FieldCodec:
    """octet[]."""

    def write(value: Any, name: str) -> list[bytes]:
        if not isinstance(value, bytes | bytearray):
            raise ConversionError(f"{name} is {shown(value)}: bytes wanted")
        check(len(value), name)
        return [bytes([each]) for each in value]

    return FieldCodec(read=b"".join, write=write)


def numbers_way(kind: str, check: SizeCheck, scale: Scale | None, *, fixed: bool) -> FieldCodec:
    """Numbers of one kind, all at once; ``fixed`` is an array whose size the type says."""
    code = NUMBERS[kind]
    factor = np.asarray(scale) if scale is not None and kind in _FLOATS else None

    def read(values: Any) -> NDArray[Any]:
        found = np.frombuffer(values, dtype=code) if len(values) else np.empty(0, dtype=code)
        return closed(found[:] if factor is None else found.astype(np.float64) * factor)

    def write(values: Any, name: str) -> Any:
        numbers = _numbers(values, name, kind)
        check(numbers.size, name)
        if factor is not None:
            numbers = numbers / factor
        numbers = np.ascontiguousarray(_fitting(numbers, name, code))
        if fixed:
            return numbers.copy()
        filled = array(code)
        if numbers.size:
            filled.frombytes(numbers.tobytes())
        return filled

    return FieldCodec(read, write)


def _numbers(values: Any, name: str, kind: str) -> NDArray[Any]:
    """Numbers (n,), row by row when they have more dimensions."""
    if isinstance(values, bytes | bytearray):
        values = np.frombuffer(values, dtype=np.uint8)
    try:
        found = np.asarray(values)
    except (ValueError, OverflowError) as error:
        raise ConversionError(f"{name} is {shown(values)}: an array of {kind} wanted") from error
    if found.size == 0:
        return np.empty(0, dtype=NUMBERS[kind])
    if found.ndim == 0 or found.dtype.kind not in ("iuf" if kind in _FLOATS else "iu"):
        raise ConversionError(f"{name} is {shown(values)}: an array of {kind} wanted")
    return found.reshape(-1)


def _fitting(numbers: NDArray[Any], name: str, code: str) -> NDArray[Any]:
    """The same numbers in the field's own type, when they fit it."""
    if numbers.dtype == np.dtype(code):
        return numbers
    if code in "fd":
        with np.errstate(over="ignore"):
            turned = numbers.astype(code)
        bad = np.isfinite(numbers) & ~np.isfinite(turned)
    else:
        limits = np.iinfo(code)
        bad = (numbers < limits.min) | (numbers > limits.max)
        turned = numbers.astype(code)
    if bad.any():
        index = int(bad.argmax())
        raise ConversionError(f"{name}[{index}] is {numbers[index]}: it does not fit the field")
    return turned


def _float(value: Any, name: str, factor: float, kind: str) -> float:
    if isinstance(value, bool | np.bool_) or not isinstance(
        value, int | float | np.integer | np.floating
    ):
        raise ConversionError(f"{name} is {shown(value)}: a number wanted")
    try:
        number = float(value) / factor
    except OverflowError as error:
        raise ConversionError(f"{name} is {shown(value)}: it does not fit the field") from error
    if kind == "float" and math.isfinite(number) and abs(number) > _LARGEST_FLOAT32:
        raise ConversionError(f"{name} is {shown(value)}: it does not fit 32 bits")
    return number


def _integer(value: Any, name: str, low: int, high: int) -> int:
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise ConversionError(f"{name} is {shown(value)}: a whole number wanted")
    if not low <= value <= high:
        raise ConversionError(f"{name} is {shown(value)}: {low} to {high} wanted")
    return int(value)


def _bool(value: Any, name: str) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise ConversionError(f"{name} is {shown(value)}: true or false wanted")
    return bool(value)


def closed(values: NDArray[Any]) -> NDArray[Any]:
    """The array, read-only from now on."""
    values.flags.writeable = False
    return values


def shown(value: Any) -> str:
    """The beginning of it, for an error."""
    return f"{value!r:.60}"
