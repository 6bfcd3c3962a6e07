"""MCAP files and rosbag2 folders: the topics of a tracker, of tf and of a robot's joints."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from app.case.readers.recording_format import Note, RecordingFormat, SideTopics
from app.files.bounded_io import is_file, is_folder

if TYPE_CHECKING:
    from app.case.frame_streams import TrackingFrame
    from app.case.readers.recording_format import RawMessage

CHANGES_NAME = "changes.yaml"
"""File in the folder of a live recording: what was replaced in the session, and when."""


def _recognises(path: Path) -> bool:
    return is_folder(path) or path.name.lower().endswith(".mcap")


def _read(path: Path, note: Note, joints: SideTopics) -> "Iterator[TrackingFrame]":
    from app.case.readers.rosbag2.bag_frames import read_mcap  # loads rosbags

    _note_changes(path, note)
    return read_mcap(path, note, joints)


def _messages(path: Path, note: Note) -> "Iterator[RawMessage]":
    from app.case.readers.rosbag2.bag import read_bag

    _note_changes(path, note)
    return read_bag(path, note)


def _note_changes(path: Path, note: Note) -> None:
    if is_file(path / CHANGES_NAME):
        note(
            f"{path.name}/{CHANGES_NAME}: tumour, structures, registration, tip or margins were "
            "replaced during this recording; here they are those of the case throughout"
        )


FORMAT = RecordingFormat(
    kinds=(".mcap", "a rosbag2 folder"),
    recognises=_recognises,
    read=_read,
    has_joints=True,
    messages=_messages,
    is_fallback=True,
)
