"""Reads ``needle``, the same in ``case.yaml`` and in ``live.yaml``."""

import math

from app.case.manifest.entries import MeshEntry, NeedleEntry, ToolEntry
from app.files.document import Section
from app.geometry import InputError

_ALONG_Z = (0.0, 0.0, 1.0)


def read_needle(document: Section, tool: ToolEntry) -> NeedleEntry | None:
    """Read ``needle``; None without one. `InputError` for one on the frame of ``tool``."""
    if "needle" not in document:
        return None
    block = document.section("needle")
    frame = block.frame("frame")
    if frame == tool.frame:
        raise InputError(
            f"{block.place('frame')} is {frame!r}, the frame of the tool; expected that of a "
            "sensor on the needle"
        )
    model = block.section("model") if "model" in block else None
    return NeedleEntry(
        frame,
        block.number("length_mm"),
        _direction(block.section("tip_from")) if "tip_from" in block else _ALONG_Z,
        None if model is None else MeshEntry(model.text("path"), model.choice("units")),
    )


def _direction(block: Section) -> tuple[float, float, float]:
    x, y, z = block.numbers("direction")
    length = math.hypot(x, y, z)
    if not 0.0 < length < math.inf:
        raise InputError(f"{block.place('direction')} has length {length:g}; expected more than 0")
    return x / length, y / length, z / length
