"""Anatomical directions, against an independent computation by angles."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import strategies as st

from app.geometry import (
    ANATOMICAL_AXES,
    ANATOMICAL_WORDS,
    InputError,
    anatomical_direction,
    anatomical_words,
)
from tests.geometry.few_examples import given

_NUMBER = st.floats(-1e6, 1e6, allow_nan=False).map(lambda value: round(value, 6))


def angle_to(letters: str, vector: list[float]) -> float:
    """Angle to the sum of the letters' axes; no code in common with the module."""
    signs = {"R": (0, 1), "L": (0, -1), "A": (1, 1), "P": (1, -1), "S": (2, 1), "I": (2, -1)}
    other = [0.0, 0.0, 0.0]
    for letter in letters:
        axis, sign = signs[letter]
        other[axis] = float(sign)
    product = math.fsum(a * b for a, b in zip(vector, other, strict=True))
    return math.acos(max(-1.0, min(1.0, product / math.hypot(*vector) / math.sqrt(len(letters)))))


def all_names() -> list[str]:
    names = ("".join(each).replace("-", "") for each in product("RL-", "AP-", "SI-"))
    return [name for name in names if name]


@given(st.lists(_NUMBER, min_size=3, max_size=3).filter(lambda v: max(map(abs, v)) > 1e-3))
def test_direction_is_the_nearest_of_the_26(vector):
    letters = anatomical_direction(np.array(vector))
    nearest = min(angle_to(name, vector) for name in all_names())
    assert angle_to(letters, vector) == pytest.approx(nearest, abs=1e-7)


@pytest.mark.parametrize(
    ("vector", "letters", "words"),
    [
        ((1, 0, 0), "R", "right"),
        ((-2, 0.3, 0), "L", "left"),
        ((0, 5, -5.1), "IA", "inferior anterior"),
        ((-1, -1.2, 1.1), "PSL", "posterior superior left"),
        ((1e300, 1e300, 0), "RA", "right anterior"),
    ],
)
def test_letters_begin_with_the_largest_component(vector, letters, words):
    assert anatomical_direction(np.array(vector)) == letters
    assert anatomical_words(letters) == words


def test_zero_has_no_direction_and_nan_is_refused():
    assert anatomical_direction(np.zeros(3)) == ""
    for bad in (np.array([np.nan, 0, 0]), np.array([np.inf, 0, 0]), np.zeros(2)):
        with pytest.raises(InputError, match="expected three finite numbers"):
            anatomical_direction(bad)


def test_axes_are_those_of_ras():
    assert set(ANATOMICAL_AXES) == set(ANATOMICAL_WORDS) == set("RLAPSI")
    for letter, axis in ANATOMICAL_AXES.items():
        assert anatomical_direction(axis) == letter
        assert not axis.flags.writeable
