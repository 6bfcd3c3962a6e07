"""Numbers of text files, against what C's strtod, by way of numpy, makes of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.files.numbers import numbers_in
from app.geometry import InputError


@given(st.lists(st.floats(), min_size=1, max_size=16))
def test_numbers_are_read_as_they_were_written(values: list[float]) -> None:
    text = "  ".join(map(repr, values))
    np.testing.assert_array_equal(numbers_in(text, len(values), "here"), values)


def test_what_trackers_write_is_read() -> None:
    assert numbers_in("-0 1e-005 +2.5\t3.\n", 4, "here") == [0.0, 1e-5, 2.5, 3.0]


@pytest.mark.parametrize("word", ["1_0", "\u0661", "x", "1,5", "0x10", "--1", "1e"])
def test_words_that_are_read_in_two_ways_or_none_are_named(word: str) -> None:
    with pytest.raises(InputError, match=f"^here: '{word}' is not a number$"):
        numbers_in(f"1 {word} nan", 3, "here")


def test_the_count_is_checked() -> None:
    with pytest.raises(InputError, match="here has 2 numbers: 3 wanted"):
        numbers_in("1 2", 3, "here")
