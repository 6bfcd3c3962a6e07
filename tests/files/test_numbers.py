"""Numbers of text files, compared with Python's own text form of floats."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.files.numbers import parse_numbers
from app.geometry import InputError


@given(st.lists(st.floats(), min_size=1, max_size=16))
def test_numbers_survive_a_round_trip(values: list[float]) -> None:
    text = "  ".join(map(repr, values))
    np.testing.assert_array_equal(parse_numbers(text, len(values), "here"), values)


def test_number_forms_of_trackers_are_accepted() -> None:
    assert parse_numbers("-0 1e-005 +2.5\t3.\n", 4, "here") == [0.0, 1e-5, 2.5, 3.0]


@pytest.mark.parametrize("word", ["1_0", "\u0661", "x", "1,5", "0x10", "--1", "1e"])
def test_error_names_the_word_that_is_ambiguous_or_not_a_number(word: str) -> None:
    with pytest.raises(InputError, match=f"^here: '{word}' is not a number$"):
        parse_numbers(f"1 {word} nan", 3, "here")


def test_wrong_count_is_refused() -> None:
    with pytest.raises(InputError, match="here has 2 numbers; expected 3"):
        parse_numbers("1 2", 3, "here")
