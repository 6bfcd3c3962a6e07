"""Differences between two runs in the values on which the permissions of a run depend."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from app.fixture import MarginParameters
from app.geometry import Transform
from app.hold.changes import margin_changes, moved_text

UsedValues = Mapping[str, Any]
"""Values for JSON: ``tumor``, ``tip``, ``registration``, ``margins`` and ``image_depth_mm``.

A pose is its frames and its matrix: ``[target, source, 16 numbers]``.
"""

_CHANGED = "not as in the last run"


def causes_of_change(before: UsedValues, now: UsedValues) -> tuple[str, ...]:
    """One text for each of tumour, tip, registration, margins and depth that differs.

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
