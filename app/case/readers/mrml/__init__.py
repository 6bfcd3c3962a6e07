"""Scenes of 3D Slicer: the sequences of transforms in ``.mrml`` files and ``.mrb`` bundles."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from app.case.readers.recording_format import Note, RecordingFormat, SideTopics, has_ending

if TYPE_CHECKING:
    from app.case.frame_streams import TrackingFrame

MRML_ENDINGS = (".mrb", ".mrml")


def _read(path: Path, note: Note, joints: SideTopics) -> "Iterator[TrackingFrame]":
    from app.case.readers.mrml.mrml_recording import read_mrml

    return read_mrml(path, note)


def _check(path: Path) -> None:
    from app.case.readers.mrml.mrml_recording import check_mrml

    check_mrml(path)


FORMAT = RecordingFormat(
    kinds=MRML_ENDINGS, recognises=has_ending(*MRML_ENDINGS), read=_read, check=_check
)
