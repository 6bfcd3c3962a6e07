"""Setting the slots of a frozen dataclass without its checks."""

from dataclasses import FrozenInstanceError, dataclass

import pytest

from app.geometry import slot_setters


@dataclass(frozen=True, slots=True)
class Span:
    first: int
    last: int

    def __post_init__(self) -> None:
        if self.last < self.first:
            raise ValueError("backwards")


def test_setters_are_in_field_order_and_the_instance_stays_frozen():
    set_first, set_last = slot_setters(Span)
    made = object.__new__(Span)
    set_first(made, 3)
    set_last(made, 5)
    assert made == Span(3, 5)
    with pytest.raises(FrozenInstanceError):
        made.last = 6  # type: ignore[misc]


def test_instance_of_another_type_is_rejected():
    set_first, _ = slot_setters(Span)
    with pytest.raises(TypeError, match="Span"):
        set_first(object(), 3)
