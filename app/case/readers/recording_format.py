"""Declaration of a recording format, which its module makes, and the registry of all formats.

The formats are found in the modules of `app.case.readers`. Loads neither numpy nor a reader: help
texts list the formats.
"""

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import app.case.readers
from app.geometry import InputError

if TYPE_CHECKING:
    from app.case.frame_streams import TrackingFrame
    from app.case.readers.rosbag2.bag_messages import RawMessage


Note: TypeAlias = Callable[[str], None]
"""Takes one sentence about what a reader skipped or assumed."""

_MAX_NOTES = 100
_MAX_NOTE_CHARS = 500


def note_to(notes: list[str]) -> Note:
    """A `Note` that adds to ``notes``, a limited number of notes of a limited length.

    A damaged or hostile recording may cause a note for each of its records.
    """

    def add(text: str) -> None:
        if len(notes) < _MAX_NOTES:
            notes.append(text if len(text) <= _MAX_NOTE_CHARS else f"{text[:_MAX_NOTE_CHARS]} ...")
        elif len(notes) == _MAX_NOTES:
            notes.append(f"more than {_MAX_NOTES} notes: the others are left out")

    return add


@dataclass(frozen=True, slots=True)
class SideTopics:
    """ROS topics of a recording beside the poses: joints of the robot, and activation.

    ``topic`` is that of the joints; None reads no joints. Their stamps are moved to the tracker's
    clock: tracker = robot + ``offset_ns``. ``activation`` is that of ``std_msgs/Bool``; what it
    said is unknown after ``activation_stale_after_ns``.
    """

    topic: str | None = None
    offset_ns: int = 0
    activation: str | None = None
    activation_stale_after_ns: int = 0


ReadFrames: TypeAlias = "Callable[[Path, Note, SideTopics], Iterator[TrackingFrame]]"
ReadAtRate: TypeAlias = "Callable[[Path, Note, float], Iterator[TrackingFrame]] | None"
ReadMessages: TypeAlias = "Callable[[Path, Note], Iterator[RawMessage]] | None"


def _accept(path: Path) -> None:
    """Accept any file: the default check."""


@dataclass(frozen=True, slots=True)
class RecordingFormat:
    """A file format of recordings.

    ``kinds``: the endings or folders that messages and help texts list. ``recognises``: true for a
    path of this format, from its name alone or from a folder's content. ``read(path, note,
    joints)`` yields the frames, and reports to ``note`` what it skipped; it raises `InputError` for
    a file that cannot be read. ``check``: raises `InputError` for a file that cannot be replayed,
    before anything is read. ``has_joints``: whether the format can hold joints of a robot.
    ``messages``: yields all messages of a recording that holds ROS messages, also those that frames
    do not need; None for other formats. ``is_fallback``: whether it is tried after all others.
    """

    kinds: tuple[str, ...]
    recognises: Callable[[Path], bool]
    read: ReadFrames
    check: Callable[[Path], None] = _accept
    has_joints: bool = False
    messages: ReadMessages = None
    read_at_rate: ReadAtRate = None
    is_fallback: bool = False


def has_ending(*endings: str) -> Callable[[Path], bool]:
    """A test for paths whose name has one of ``endings``, in capitals or not."""
    return lambda path: path.name.lower().endswith(endings)


_NONE = SideTopics()


def recording_formats() -> tuple[RecordingFormat, ...]:
    """Every format in the order in which they are tried: by module name, fallbacks last."""
    names = sorted(module.name for module in pkgutil.iter_modules(app.case.readers.__path__))
    found: list[RecordingFormat] = [
        importlib.import_module(f"app.case.readers.{name}").FORMAT
        for name in names
        if name != "recording_format"
    ]
    return tuple(sorted(found, key=lambda each: each.is_fallback))


def recording_kinds() -> str:
    """The endings and folders of all formats, for messages and help texts."""
    return ", ".join(kind for each in recording_formats() for kind in each.kinds)


def format_of(path: Path) -> RecordingFormat:
    """The format of the recording at ``path``; `InputError` where none recognises it."""
    for each in recording_formats():
        if each.recognises(path):
            return each

    raise InputError(f"{path} is not a recording; expected one of {recording_kinds()}")


def read_recording(
    path: Path, note: Note, joints: SideTopics = _NONE, rate_hz: float | None = None
) -> "Iterator[TrackingFrame]":
    """Yield the frames of the recording at ``path``, in any of the formats.

    ``note`` takes what the reader skipped or assumed. ``rate_hz`` is that of a recording without
    times. Raises `InputError` for an unknown format, for a recording that cannot be read, and for a
    rate of a recording that has times.
    """
    found = format_of(path)
    if rate_hz is None:
        return found.read(path, note, joints)
    if found.read_at_rate is None:
        raise InputError(
            f"{path} has times of its own; expected no rate (recording.rate_hz, --rate-hz)"
        )
    return found.read_at_rate(path, note, rate_hz)
