"""Logs of PerkTutor and of the TransformRecorder of SlicerIGT: one XML element per pose."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from app.case.readers.recording_format import Note, RecordingFormat, SideTopics
from app.files.bounded_io import open_regular
from app.geometry import InputError

if TYPE_CHECKING:
    from app.case.frame_streams import TrackingFrame

ROOT = "TransformRecorderLog"
_HEAD_BYTES = 4096


def _recognises(path: Path) -> bool:
    """True for an ``.xml`` file whose first element is the log: PLUS configurations are XML too."""
    if not path.name.lower().endswith(".xml"):
        return False

    try:
        with open_regular(path) as file:
            return f"<{ROOT}".encode() in file.read(_HEAD_BYTES)
    except (InputError, OSError):
        return False


def _read(path: Path, note: Note, joints: SideTopics) -> "Iterator[TrackingFrame]":
    from app.case.readers.perk_tutor.perk_tutor_log import read_log

    return read_log(path, note)


def _check(path: Path) -> None:
    from app.case.readers.perk_tutor.perk_tutor_log import check_log

    check_log(path)


FORMAT = RecordingFormat(
    kinds=(".xml of PerkTutor",), recognises=_recognises, read=_read, check=_check
)
