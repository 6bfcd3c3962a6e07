"""Sequence metafiles of IGSIO, as PLUS writes them, and of 3D Slicer: poses in a text header."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from app.case.readers.recording_format import Note, RecordingFormat, SideTopics, has_ending

if TYPE_CHECKING:
    from app.case.frame_streams import TrackingFrame

_ENDINGS = (".igs.mha", ".igs.mhd", ".igs.nrrd", ".igs.nhdr", ".seq.mha", ".seq.mhd", ".seq.nrrd")


def _read(path: Path, note: Note, joints: SideTopics) -> "Iterator[TrackingFrame]":
    from app.case.readers.igsio.igsio_header import read_igsio

    return read_igsio(path, note)


def _read_at_rate(path: Path, note: Note, rate_hz: float) -> "Iterator[TrackingFrame]":
    from app.case.readers.igsio.igsio_header import read_igsio

    return read_igsio(path, note, rate_hz)


def _check(path: Path) -> None:
    from app.case.readers.igsio.igsio_header import check_igsio_header

    check_igsio_header(path)


FORMAT = RecordingFormat(
    kinds=_ENDINGS,
    recognises=has_ending(*_ENDINGS),
    read=_read,
    check=_check,
    read_at_rate=_read_at_rate,
)
