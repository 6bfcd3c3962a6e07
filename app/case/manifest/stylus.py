"""Reads ``stylus``, the same in ``case.yaml`` and in ``live.yaml``."""

import numpy as np

from app.case.manifest.entries import (
    REFERENCE_FRAME,
    NeedleEntry,
    StylusEntry,
    ToolEntry,
    TumorEntry,
)
from app.case.manifest.sections import read_pose
from app.case.manifest.stylus_keys import MIN_STYLUS_MM
from app.files.document import Section
from app.geometry import InputError


def read_stylus(
    document: Section, tool: ToolEntry, tumor: TumorEntry, needle: NeedleEntry | None
) -> StylusEntry | None:
    """Read ``stylus``; None without one.

    Raises `InputError` for one on the frame of another part, and for a tip at its sensor's origin.
    """
    if "stylus" not in document:
        return None
    block = document.section("stylus")
    frame = block.frame("frame")
    taken = {REFERENCE_FRAME: "the reference", tumor.frame: "the frame of the tumour"}
    if needle is not None:
        taken[needle.frame] = "the frame of the needle"
    taken[tool.frame] = "the frame of the tool"
    if frame in taken:
        raise InputError(
            f"{block.place('frame')} is {frame!r}, {taken[frame]}; expected that of a sensor on "
            "the stylus"
        )
    tip = None
    if "tip_from" in block:
        tip = read_pose(block, "tip_from", target=frame, source=f"{frame}_tip")
        length_mm = float(np.linalg.norm(tip.translation_mm))
        if length_mm < MIN_STYLUS_MM:
            raise InputError(
                f"{block.place('tip_from')} is {length_mm:.3g} mm from the sensor's origin; "
                f"expected {MIN_STYLUS_MM:g} mm or more, or no tip_from before a calibration"
            )
    return StylusEntry(frame, tip, block.number("sigma_mm"))
