"""Texts of changed margins and poses for an operator, and which margins permit more.

Looser margins apply only when an operator who has seen the change re-arms.
"""

import math

from app.fixture import MarginParameters
from app.geometry import NS_PER_MS, Transform

LOOSER_BELOW = (
    "stop_mm",
    "warn_mm",
    "k_tre",
    "v_max_mm_s",
    "release_samples",
    "release_band_mm",
)
"""Margins whose lower value permits more, or ends a worse state earlier."""

LOOSER_ABOVE = ("stale_after_ns", "frozen_after_ns")
"""Margins whose higher value permits motion on older data."""


def tightest_margins(
    in_use: MarginParameters, requested: MarginParameters, *, follows_tumor: bool
) -> MarginParameters:
    """``requested`` without what loosens ``in_use``: what applies until a re-arm."""
    kept = {
        name: getattr(in_use, name)
        for name in MarginParameters.ranges()
        if _is_looser(name, in_use, requested, follows_tumor)
    }
    return requested.replaced(**kept)


def loosened_margins(
    before: MarginParameters, after: MarginParameters, *, follows_tumor: bool
) -> list[str]:
    """Texts of the margins that are looser in ``after``, such as "stop_mm lowered from 2 to 1".

    ``v_max_mm_s`` works both ways: a lower value adds less for the age of the data, a higher one
    lets the tool follow a receding tumour faster, in a session that ``follows_tumor``.
    """
    return [
        change_text(name, getattr(before, name), getattr(after, name))
        for name in MarginParameters.ranges()
        if _is_looser(name, before, after, follows_tumor)
    ]


def _is_looser(
    name: str, before: MarginParameters, after: MarginParameters, follows_tumor: bool
) -> bool:
    old, new = getattr(before, name), getattr(after, name)
    higher_is_looser = name in LOOSER_ABOVE or (name == "v_max_mm_s" and follows_tumor)
    return bool((name in LOOSER_BELOW and new < old) or (higher_is_looser and new > old))


def margin_changes(before: MarginParameters, after: MarginParameters) -> list[str]:
    """Texts of all margins that differ."""
    values = ((name, getattr(before, name), getattr(after, name)) for name in before.ranges())
    return [change_text(name, old, new) for name, old, new in values if old != new]


def change_text(name: str, old: float, new: float) -> str:
    """Name a margin as in `case.yaml`, times in ms, with its old and new value."""
    if name.endswith("_ns"):
        name, old, new = name.removesuffix("_ns") + "_ms", old / NS_PER_MS, new / NS_PER_MS
    return f"{name} {'lowered' if new < old else 'raised'} from {_number(old)} to {_number(new)}"


def _number(value: float) -> str:
    """All digits of ``value``: two different numbers have different texts."""
    return repr(int(value)) if float(value).is_integer() else repr(float(value))


def tip_change_text(before: Transform, after: Transform) -> str:
    """Text of the shift of a tip (mm) and the turn of its frame (degrees)."""
    shift_mm, turn_deg = before.distance_mm_to(after), math.degrees(before.angle_to(after))
    return f"the tip is moved by {shift_mm:.2f} mm and its axis turned by {turn_deg:.2f} degrees"


def moved_text(what: str, before: Transform, after: Transform) -> str:
    """Text of the shift (mm) and turn (degrees) of ``what`` between two poses of its frames."""
    shift_mm, turn_deg = before.distance_mm_to(after), math.degrees(before.angle_to(after))
    return f"{what} is moved by {shift_mm:.2f} mm and turned by {turn_deg:.2f} degrees"
