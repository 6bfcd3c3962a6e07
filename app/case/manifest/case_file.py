"""Reads and checks ``case.yaml``."""

from pathlib import Path

from app.case.manifest.entries import CaseManifest, RecordingEntry
from app.case.manifest.sections import (
    check_schema,
    read_clock,
    read_margins,
    read_provenance,
    read_registration,
    read_robot,
    read_tool,
    read_tumor,
)
from app.files.document import Section
from app.geometry import InputError

MANIFEST_NAME = "case.yaml"


def load_manifest(folder: Path) -> CaseManifest:
    """Read ``case.yaml`` of ``folder``; `InputError` for the first fault."""
    path = folder / MANIFEST_NAME
    if not path.is_file():
        raise InputError(f"{folder} is not a case: it has no {MANIFEST_NAME}")
    document = Section.load(
        path,
        (
            "schema",
            "name",
            "provenance",
            "recording",
            "clock",
            "tool",
            "tumor",
            "robot",
            "registration",
            "margins",
            "expected",
        ),
    )
    check_schema(document)
    robot, tool = read_robot(document), read_tool(document)
    return CaseManifest(
        file=MANIFEST_NAME,
        name=document.text("name"),
        provenance=read_provenance(document),
        recording=_recording(document),
        clock=read_clock(document),
        tool=tool,
        tumor=read_tumor(document, tool),
        robot=robot,
        registration=read_registration(document, robot),
        margins=read_margins(document),
        expected=document.text("expected") if "expected" in document else None,
    )


def _recording(document: Section) -> RecordingEntry:
    block = document.section("recording", ("path", "sha256"))
    sha256 = None
    if "sha256" in block:
        sha256 = block.text("sha256").lower()
        if len(sha256) != 64 or not set(sha256) <= set("0123456789abcdef"):
            raise InputError(
                f"{block.place('sha256')} is {sha256!r}; expected 64 hexadecimal digits"
            )
    return RecordingEntry(block.text("path"), sha256)
