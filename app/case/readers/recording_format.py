"""Recording formats: declaration, registry, and the messages that the readers of bags yield.

Each module of `app.case.readers` declares its format here. Loads neither numpy nor a reader: help
texts list the formats.
"""

import importlib
import pkgutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import app.case.readers
from app.geometry import InputError

if TYPE_CHECKING:
    from app.case.frame_streams import TrackingFrame


MAX_MESSAGE_BYTES = 64 * 1024 * 1024
"""Maximum size of a message, of any other record and of an unpacked chunk."""

MAX_DEFINITION_BYTES = 1024 * 1024
"""Maximum size of the definition of one message type, with those of nested types."""

MAX_CONNECTIONS = 4096
"""Maximum number of different topics, types and definitions of a recording."""

MAX_RUN_MESSAGES = 1024
MAX_RUN_BYTES = 1024 * 1024
"""A run of messages ends at either."""

RunMessage: TypeAlias = tuple[int, bytes, int, int, int]
"""A message of a `MessageRun`: number of its connection, data, log_ns, publish_ns, sequence.

A plain tuple, because a recording holds hundreds of messages per second.
"""


@dataclass(frozen=True, eq=False)
class Connection:
    """A topic of a recording. ``schema`` is the definition of its type, in ``schema_encoding``.

    ``metadata`` are the key/value pairs of an MCAP channel, such as the QoS profiles offered.
    Compared by identity, which is fast: there is a look-up per message.
    """

    topic: str
    message_type: str
    schema: bytes
    schema_encoding: str
    message_encoding: str = "cdr"
    metadata: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def definition(self) -> str:
        """The text of the definition; empty where the recording has none."""
        return self.schema.decode("utf-8", errors="replace")


class RawMessage(NamedTuple):
    """A message as recorded: its bytes, and its times in ns."""

    connection: Connection
    data: bytes
    log_ns: int
    publish_ns: int
    sequence: int


class MessageRun(NamedTuple):
    """Messages that follow each other in a recording, so that they can be decoded together.

    ``connections`` by their numbers; messages of other numbers have none and are not used. It is
    valid until the next run is read.
    """

    connections: Mapping[int, Connection]
    messages: list[RunMessage]

    def raw_messages(self) -> Iterator[RawMessage]:
        """Yield those messages that have a connection."""
        for number, data, log_ns, publish_ns, sequence in self.messages:
            connection = self.connections.get(number)
            if connection is not None:
                yield RawMessage(connection, data, log_ns, publish_ns, sequence)


class MessagePlace(NamedTuple):
    """Where a message of an MCAP file is: ``offset`` is that of a record at or before it.

    ``number`` counts the messages of ``connection`` from there.
    """

    offset: int
    connection: int
    number: int


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
