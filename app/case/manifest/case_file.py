"""Reads and checks ``case.yaml``."""

from pathlib import Path

from app.case.manifest.cautery import read_cautery
from app.case.manifest.entries import CaseManifest, RecordingEntry
from app.case.manifest.images import read_images
from app.case.manifest.keys import CASE
from app.case.manifest.needle import read_needle
from app.case.manifest.plausibility import read_plausibility
from app.case.manifest.sections import (
    read_clock,
    read_margins,
    read_package_dirs,
    read_provenance,
    read_registration,
    read_robot,
    read_tool,
    read_tumor,
)
from app.case.manifest.stylus import read_stylus
from app.files.document import Section
from app.geometry import InputError

MANIFEST_NAME = "case.yaml"


def load_manifest(folder: Path) -> CaseManifest:
    """Read ``case.yaml`` of ``folder``; `InputError` for the first fault."""
    path = folder / MANIFEST_NAME
    if not path.is_file():
        raise InputError(f"{folder} is not a case: it has no {MANIFEST_NAME}")
    return read_manifest(Section.load(path, CASE))


def read_manifest(document: Section) -> CaseManifest:
    """Read a document with the keys of `CASE`; `InputError` for the first fault."""
    document.integer("schema")
    robot, tool = read_robot(document), read_tool(document)
    tumor, needle = read_tumor(document, tool), read_needle(document, tool)
    return CaseManifest(
        file=MANIFEST_NAME,
        name=document.text("name"),
        provenance=read_provenance(document),
        recording=_recording(document.section("recording")),
        clock=read_clock(document),
        tool=tool,
        tumor=tumor,
        robot=robot,
        registration=read_registration(document, robot),
        margins=read_margins(document),
        plausibility=read_plausibility(document),
        expected=document.text("expected") if "expected" in document else None,
        package_dirs=read_package_dirs(document),
        images=read_images(document),
        needle=needle,
        stylus=read_stylus(document, tool, tumor, needle),
        cautery=read_cautery(document),
    )


def _recording(block: Section) -> RecordingEntry:
    sha256 = block.text("sha256").lower() if "sha256" in block else None
    rate_hz = block.number("rate_hz") if "rate_hz" in block else None
    return RecordingEntry(block.text("path"), sha256, rate_hz)
