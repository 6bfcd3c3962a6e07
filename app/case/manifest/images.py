"""Reads ``images`` of a ``case.yaml`` and of a ``live.yaml``."""

from app.case.manifest.entries import ImagesEntry
from app.files.document import Section
from app.geometry import NS_PER_MS, InputError


def read_images(document: Section) -> ImagesEntry | None:
    """Read ``images``; None for a case without images."""
    if "images" not in document:
        return None
    block = document.section("images")
    stale_ms = block.number("stale_after_ms") if "stale_after_ms" in block else None
    if "path" in block and "topic" in block:
        raise InputError(f"{block.where} has path and topic; expected one of them or none")
    return ImagesEntry(
        block.text("path") if "path" in block else None,
        block.frame("probe"),
        block.text("calibration"),
        block.choice("orientation") if "orientation" in block else None,
        None if stale_ms is None else round(stale_ms * NS_PER_MS),
        block.text("topic") if "topic" in block else None,
    )
