"""Reads ``images`` of a ``case.yaml`` and of a ``live.yaml``."""

from app.case.manifest.entries import ImageCalibrationEntry, ImagesEntry
from app.files.document import Section
from app.geometry import NS_PER_MS, InputError

_SAME_MM = 0.01
"""Depths that differ by less are one."""


def read_images(document: Section) -> ImagesEntry | None:
    """Read ``images``; None for a case without images."""
    if "images" not in document:
        return None
    block = document.section("images")
    stale_ms = block.number("stale_after_ms") if "stale_after_ms" in block else None
    if "path" in block and "topic" in block:
        raise InputError(f"{block.where} has path and topic; expected one of them or none")
    calibrations, depth_mm = _calibrations(block)
    return ImagesEntry(
        block.text("path") if "path" in block else None,
        block.frame("probe"),
        calibrations,
        block.choice("orientation") if "orientation" in block else None,
        None if stale_ms is None else round(stale_ms * NS_PER_MS),
        block.text("topic") if "topic" in block else None,
        depth_mm,
    )


def _calibrations(block: Section) -> tuple[tuple[ImageCalibrationEntry, ...], float | None]:
    """The calibrations, and the depth at the start; None for the one of a probe with one depth."""
    if "calibrations" not in block:
        if "depth_mm" in block:
            raise InputError(f"{block.place('depth_mm')} is given; expected calibrations with it")
        return (ImageCalibrationEntry(None, block.text("calibration"), None),), None
    if "calibration" in block:
        raise InputError(f"{block.where} has calibration and calibrations; expected one of them")
    entries = tuple(_entry(each) for each in block.sections("calibrations"))
    depths_mm = [each.depth_mm or 0.0 for each in entries]
    for index, depth_mm in enumerate(depths_mm):
        if any(abs(depth_mm - other) < _SAME_MM for other in depths_mm[:index]):
            raise InputError(
                f"{block.place('calibrations')}: depth_mm {depth_mm:g} is listed twice; expected "
                "each depth once"
            )
    start_mm = block.number("depth_mm")
    listed = ", ".join(f"{each:g}" for each in depths_mm)
    found = [each for each in depths_mm if abs(each - start_mm) < _SAME_MM]
    if not found:
        raise InputError(
            f"{block.place('depth_mm')} is {start_mm:g}; expected one of calibrations: {listed}"
        )
    return entries, found[0]


def _entry(block: Section) -> ImageCalibrationEntry:
    if ("path" in block) is ("matrix" in block):
        given = "both" if "path" in block else "neither"
        raise InputError(f"{block.where} has {given} of path and matrix; expected one of them")
    return ImageCalibrationEntry(
        block.number("depth_mm"),
        block.text("path") if "path" in block else None,
        block.numbers("matrix") if "matrix" in block else None,
    )
