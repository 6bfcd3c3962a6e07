"""Texts of changed margins, poses and other values that a run uses, and which margins permit more.

Looser margins apply only when an operator who has seen the change re-arms.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

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

UsedValues = Mapping[str, Any]
"""Values for JSON: ``tumor``, ``tip``, ``registration``, ``margins`` and ``image_depth_mm``.

A pose is its frames and its matrix: ``[target, source, 16 numbers]``.
"""

_CHANGED = "not as in the last run"


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


def causes_of_change(before: UsedValues, now: UsedValues) -> tuple[str, ...]:
    """One text for each of tumour, tip, registration, margins, depth and structure that differs.

    A run that begins with other values than those that an operator has last acknowledged begins on
    hold, and a re-arm acknowledges the new ones.
    """
    if before == now:
        return ()
    texts = (
        _tumor_text(before["tumor"], now["tumor"]),
        _tip_text(before["tip"], now["tip"]),
        _registration_text(before["registration"], now["registration"]),
        _margins_text(before["margins"], now["margins"]),
        _depth_text(before["image_depth_mm"], now["image_depth_mm"]),
        # A record of an earlier version has none.
        *_structure_texts(before.get("structures", {}), now["structures"]),
    )
    return tuple(f"{_CHANGED}: {text}" for text in texts if text)


def _moved(what: str, old: list[Any], new: list[Any]) -> str:
    """A text with the shift and turn of a pose; empty if it has not changed."""
    if old == new:
        return ""
    if old[:2] != new[:2]:
        return f"{what} is {new[1]!r} in {new[0]!r} instead of {old[1]!r} in {old[0]!r}"
    before, after = (
        Transform.from_matrix(np.reshape(numbers, (4, 4)), target=target, source=source)
        for target, source, numbers in (old, new)
    )
    return moved_text(what, before, after)


def _sigma_text(what: str, old: float, new: float) -> str:
    return "" if old == new else f"uncertainty of {what} {new:.2f} instead of {old:.2f} mm"


def _tumor_text(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    if old["surface"] != new["surface"]:
        return f"the tumour is {new['surface']} instead of {old['surface']}"
    moved = _moved("the tumour", old["pose"], new["pose"])
    return moved or _sigma_text("the tumour", old["sigma_mm"], new["sigma_mm"])


def _structure_texts(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    found = []
    for name in sorted({*old, *new}):
        what, before, now = f"structure {name!r}", old.get(name), new.get(name)
        if before is None or now is None:
            found.append(f"{what} {'added' if before is None else 'removed'}")
            continue
        if before["surface"] != now["surface"]:
            found.append(f"{what} is {now['surface']} instead of {before['surface']}")
        numbers = (
            f"{key} {now[key]:g} instead of {before[key]:g}"
            for key in ("stop_mm", "warn_mm", "sigma_mm")
            if now[key] != before[key]
        )
        texts = (_moved(what, before["pose"], now["pose"]), *numbers)
        found += [text if text.startswith(what) else f"{what}: {text}" for text in texts if text]
    return found


def _tip_text(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    moved = _moved("the tip", old["pose"], new["pose"])
    return moved or _sigma_text("the tip", old["sigma_mm"], new["sigma_mm"])


def _registration_text(old: list[Any] | None, new: list[Any] | None) -> str:
    if old is None or new is None:
        return "" if old is new else f"registration {'added' if old is None else 'removed'}"
    return _moved("the robot's base", old, new)


def _margins_text(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    return ", ".join(margin_changes(MarginParameters(**old), MarginParameters(**new)))


def _depth_text(old: float | None, new: float | None) -> str:
    was, is_now = ("not stated" if each is None else f"{each:g} mm" for each in (old, new))
    return "" if old == new else f"the depth of the images is {is_now} instead of {was}"
