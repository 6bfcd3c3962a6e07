"""Filling the slots of a frozen value without its checks."""

from dataclasses import FrozenInstanceError, dataclass

import pytest

from app.geometry import setters


@dataclass(frozen=True, slots=True)
class Span:
    first: int
    last: int

    def __post_init__(self) -> None:
        if self.last < self.first:
            raise ValueError("backwards")


def test_slots_are_filled_in_the_order_of_the_fields_and_the_value_stays_frozen() -> None:
    set_first, set_last = setters(Span)
    made = object.__new__(Span)
    set_first(made, 3)
    set_last(made, 5)
    assert made == Span(3, 5)
    with pytest.raises(FrozenInstanceError):
        made.last = 6  # type: ignore[misc]


def test_a_value_of_another_type_is_refused() -> None:
    set_first, _ = setters(Span)
    with pytest.raises(TypeError, match="Span"):
        set_first(object(), 3)
