"""Values as JSON types, for another process, by cattrs: dataclasses, arrays and paths."""

from enum import Enum
from pathlib import Path
from typing import Any, TypeVar, get_origin

import cattrs
import numpy as np

from app.geometry import InputError

_Value = TypeVar("_Value")


def plain_converter() -> cattrs.Converter:
    """A new converter of dataclasses to JSON types and back.

    Numbers stay exact. What is read is checked: a key that no field has is an error, and so is a
    value of another type.
    """
    converter = cattrs.Converter(forbid_extra_keys=True, detailed_validation=False)
    for kind in (bool, int, str):
        converter.register_structure_hook(kind, _exactly)
    converter.register_structure_hook(float, _number)
    converter.register_unstructure_hook(Path, str)
    converter.register_structure_hook(Path, lambda value, _: Path(_exactly(value, str)))
    converter.register_unstructure_hook_func(_is_array, lambda value: value.tolist())
    converter.register_structure_hook_func(
        _is_array, lambda value, _: np.array(value, dtype=np.float64)
    )
    return converter


def _exactly(value: Any, kind: type[_Value]) -> _Value:
    if issubclass(kind, Enum):  # of texts or integers
        return kind(value)
    if type(value) is not kind:
        raise InputError(f"{value!r:.60}: is no {kind.__name__}; expected one")
    return value


def _number(value: Any, _: object) -> float:
    if type(value) not in (float, int):
        raise InputError(f"{value!r:.60}: is no number; expected one")
    return float(value)


def _is_array(kind: Any) -> bool:
    return kind is np.ndarray or get_origin(kind) is np.ndarray
