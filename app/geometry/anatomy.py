"""Anatomical directions: right, left, anterior, posterior, superior, inferior.

The axes are those of RAS (right, anterior, superior), which the coordinates of a tumour's file have
(`docs/case_format.md`, axes). A tumour that was marked in a sensor's frame has that sensor's axes.
"""

import itertools
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from app.geometry.errors import InputError
from app.geometry.transform import FloatArray


def _unit(axis: int, sign: float) -> FloatArray:
    vector = np.zeros(3)
    vector[axis] = sign
    vector.flags.writeable = False
    return vector


ANATOMICAL_AXES: Mapping[str, FloatArray] = MappingProxyType(
    {
        "R": _unit(0, 1.0),
        "L": _unit(0, -1.0),
        "A": _unit(1, 1.0),
        "P": _unit(1, -1.0),
        "S": _unit(2, 1.0),
        "I": _unit(2, -1.0),
    }
)
"""Unit vectors (3,) in RAS of the six directions, by their letters."""

ANATOMICAL_WORDS: Mapping[str, str] = MappingProxyType(
    {
        "R": "right",
        "L": "left",
        "A": "anterior",
        "P": "posterior",
        "S": "superior",
        "I": "inferior",
    }
)


def anatomical_direction(vector: FloatArray) -> str:
    """Letters of the nearest of the 26 directions, the largest component first; empty for zero.

    ``vector`` (3,) is in RAS. The 26 directions are the axes (``R``), and the diagonals between two
    (``RS``) and three (``ARS``) of them. Raises `InputError` for values that are not finite.

    >>> anatomical_direction(np.array([3.0, 0.1, -2.0]))
    'RI'
    """
    given = np.asarray(vector, dtype=float)
    if given.shape != (3,) or not np.isfinite(given).all():
        raise InputError(f"direction: {given}; expected three finite numbers")
    largest = float(np.abs(given).max())
    if largest == 0.0:
        return ""
    given = given / largest  # a square of a large number would overflow
    signs = max(_DIRECTIONS, key=lambda each: float(given @ each) / float(np.linalg.norm(each)))
    order = sorted(np.flatnonzero(signs), key=lambda axis: -abs(given[axis]))
    return "".join("RAS"[axis] if signs[axis] > 0.0 else "LPI"[axis] for axis in order)


def anatomical_words(letters: str) -> str:
    """``RI`` as ``right inferior``."""
    return " ".join(ANATOMICAL_WORDS[letter] for letter in letters)


_DIRECTIONS = tuple(
    np.array(signs, dtype=float) for signs in itertools.product((-1, 0, 1), repeat=3) if any(signs)
)
