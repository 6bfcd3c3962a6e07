"""Fast construction of frozen, slotted dataclasses without their checks."""

from collections.abc import Callable
from typing import Any


def slot_setters(value_type: type) -> tuple[Callable[[object, Any], None], ...]:
    """Return one setter per field of a frozen, slotted dataclass, in the order of its fields.

    A class method ``unchecked`` fills a new instance with them. A call takes half the time of
    `object.__setattr__`.
    """
    slots: tuple[str, ...] = vars(value_type)["__slots__"]
    return tuple(vars(value_type)[name].__set__ for name in slots)
