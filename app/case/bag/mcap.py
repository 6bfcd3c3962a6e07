"""MCAP files and rosbag2 folders as tracker frames.

``/tracked_transforms`` carries samples with their status. ``/tf`` serves for the edges that are
not on it: an edge belongs to ``/tracked_transforms`` from its first sample there on. ``/tf_static``
is not read, for it holds nothing measured. Message types come from the recording itself.
"""

import struct
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosbags.interfaces.typing import Typesdict
from rosbags.serde import SerdeError
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.store import Typestore

from app.case.bag.mcap_messages import Connection, RawMessage, read_mcap_messages
from app.case.bag.message_bytes import bytes_reader
from app.case.bag.message_values import (
    JointValues,
    PoseValues,
    TimeValues,
    joint_values,
    tf_values,
    time_values,
    tracked_values,
)
from app.case.bag.ros_messages import (
    JOINT_STATE,
    TF_MESSAGE,
    TF_TOPIC,
    TIME_REFERENCE,
    TRACKED_TRANSFORM,
    TRACKED_TRANSFORMS_TOPIC,
    UNFILTERED_TIME_TOPIC,
    ros_types,
)
from app.case.frames.assembly import FrameAssembler
from app.case.frames.samples import TrackingFrame
from app.geometry import InputError, MarginGuardError, Stamp

if TYPE_CHECKING:
    from rosbags.interfaces import Connection as BagConnection

Note = Callable[[str], None]

# What rosbags raises on definitions of no use; one that holds itself has no end.
_USELESS = (TypesysError, KeyError, RecursionError)

CHANGES_NAME = "changes.yaml"
"""Lies in a folder during whose recording a session got another tumour or registration."""


def read_mcap(
    path: Path, note: Note, *, joint_states_topic: str | None, offset_ns: int = 0
) -> Iterator[TrackingFrame]:
    """Yield the frames of an MCAP file or rosbag2 folder, ordered by acquisition stamp.

    Joint stamps are moved to the tracker's clock, tracker = robot + ``offset_ns``. What is cut,
    damaged or unreadable is skipped and told to ``note``. Raises `InputError` when the recording
    holds no tracked transform at all.
    """
    if (path / CHANGES_NAME).is_file():
        note(
            f"{path.name}/{CHANGES_NAME}: tumour or registration were replaced while this was "
            "recorded; here they are those of the case throughout"
        )
    frames = 0
    for frame in _Reading(note, joint_states_topic, offset_ns).frames(_messages(path, note)):
        frames += 1
        yield frame
    if not frames:
        raise InputError(
            f"{path} holds no sample that can be read on {TRACKED_TRANSFORMS_TOPIC} or {TF_TOPIC}"
        )


class _Reading:
    """One pass over a recording."""

    def __init__(self, note: Note, joint_states_topic: str | None, offset_ns: int) -> None:
        self._note = note
        self._offset_ns = offset_ns
        self._assembler = FrameAssembler(note)
        self._tracked_edges: set[tuple[str, str]] = set()
        self._unreadable: Counter[str] = Counter()
        self._uses: dict[str, tuple[str, Callable[[Any], Iterable[TrackingFrame]]]] = {
            TRACKED_TRANSFORMS_TOPIC: (TRACKED_TRANSFORM, self._tracked),
            TF_TOPIC: (TF_MESSAGE, self._tf),
            UNFILTERED_TIME_TOPIC: (TIME_REFERENCE, self._unfiltered),
        }
        if joint_states_topic is not None:
            self._uses[joint_states_topic] = (JOINT_STATE, self._joints)
        self._takers: dict[Connection, Callable[[bytes], Iterable[TrackingFrame]]] = {}

    def frames(self, messages: Iterator[RawMessage]) -> Iterator[TrackingFrame]:
        for connection, data in messages:
            take = self._takers.get(connection)
            if take is None:
                take = self._takers[connection] = self._taker(connection)
            try:
                yield from take(data)
            except (SerdeError, MarginGuardError, AttributeError, TypeError) as error:
                self._skip(connection.topic, error)
        yield from self._assembler.flush()
        for topic, count in self._unreadable.items():
            if count > 1:
                self._note(f"{count} messages on {topic} were skipped in all")

    def _taker(self, connection: Connection) -> Callable[[bytes], Iterable[TrackingFrame]]:
        """What takes the messages of a connection, and gives the frames that are complete then."""
        wanted_type, use = self._uses.get(connection.topic, ("", None))
        if use is None:
            return lambda data: ()
        if connection.message_type != wanted_type:
            raise InputError(
                f"topic {connection.topic} carries {connection.message_type}: {wanted_type} wanted"
            )

        @cache  # a definition that is of no use is told for every message
        def read() -> Callable[[bytes], Any]:
            return _reader(connection)

        return lambda data: use(read()(data))

    def _skip(self, topic: str, error: Exception) -> None:
        self._unreadable[topic] += 1
        if self._unreadable[topic] == 1:
            self._note(f"a message on {topic} cannot be used and is skipped: {error}")

    def _tracked(self, values: PoseValues) -> Iterable[TrackingFrame]:
        self._tracked_edges.add(values.edge)
        return self._assembler.add_pose(values.sample())

    def _tf(self, poses: tuple[PoseValues, ...]) -> Iterable[TrackingFrame]:
        for values in poses:
            if values.edge not in self._tracked_edges:
                yield from self._assembler.add_pose(values.sample())

    def _unfiltered(self, values: TimeValues) -> Iterable[TrackingFrame]:
        self._assembler.add_unfiltered(Stamp(values.ns), Stamp(values.unfiltered_ns))
        return ()

    def _joints(self, values: JointValues) -> Iterable[TrackingFrame]:
        self._assembler.add_joints(values.sample(offset_ns=self._offset_ns))
        return ()


_VALUES_OF: dict[str, Callable[[Any], Any]] = {
    TRACKED_TRANSFORM: tracked_values,
    TF_MESSAGE: tf_values,
    JOINT_STATE: joint_values,
    TIME_REFERENCE: time_values,
}


def values_reader(message_type: str) -> Callable[[bytes], Any]:
    """What reads messages of this type as they come from a live topic, in CDR.

    It gives what `app.case.bag.message_values` has for the type, and raises `InputError` for bytes
    that are no such message.
    """
    read = _reader(Connection("", message_type, "", ""))

    def read_data(data: bytes) -> Any:
        try:
            return read(data)
        # What rosbags raises on bytes that are not what they should be.
        except (SerdeError, ValueError, IndexError, struct.error, MemoryError) as error:
            reason = (str(error) or type(error).__name__).splitlines()[0]
            raise InputError(f"{len(data)} bytes are no {message_type}: {reason}") from error

    return read_data


def _reader(connection: Connection) -> Callable[[bytes], Any]:
    message_type = connection.message_type
    definitions = _definitions(connection)
    read_bytes = bytes_reader(definitions, message_type)
    values_of = _VALUES_OF[message_type]

    @cache  # it takes its time: not before there is a message that needs it
    def types() -> Typestore:
        return _typestore(definitions, message_type) if connection.definition else ros_types()

    if read_bytes is None:
        types()  # raises where the definition is of no use

    def read(data: bytes) -> Any:
        values = None if read_bytes is None else read_bytes(data)
        return values_of(types().deserialize_cdr(data, message_type)) if values is None else values

    return read


def _definitions(connection: Connection) -> Typesdict:
    if not connection.definition:  # a bag from before Iron has none
        return ros_types().fielddefs
    try:
        if connection.definition_encoding == "ros2idl":
            return get_types_from_idl(connection.definition)
        return get_types_from_msg(connection.definition, connection.message_type)
    except _USELESS as error:
        raise _useless(connection.message_type, error) from error


def _typestore(definitions: Typesdict, message_type: str) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(definitions)
        store.get_msgdef(message_type)
    except _USELESS as error:
        raise _useless(message_type, error) from error
    return store


def _useless(message_type: str, error: Exception) -> InputError:
    reason = str(error).splitlines()[0]
    return InputError(f"the definition of {message_type} in the recording cannot be used: {reason}")


def _messages(path: Path, note: Note) -> Iterator[RawMessage]:
    if path.is_file():
        yield from read_mcap_messages(path, note)
        return
    # rosbag2 numbers the parts of a bag: _2 before _10. Its metadata.yaml is missing after a crash,
    # so it is not asked for.
    parts = sorted(path.glob("*.mcap"), key=lambda part: (len(part.name), part.name))
    if parts:
        for part in parts:
            yield from read_mcap_messages(part, note)
    else:
        yield from _sqlite_messages(path)


def _sqlite_messages(path: Path) -> Iterator[RawMessage]:
    from rosbags.rosbag2 import Reader  # slow to load

    try:
        with Reader(path) as bag:
            connections = {known.id: _connection(known) for known in bag.connections}
            for known, _, data in bag.messages():
                yield connections[known.id], bytes(data)
    except Exception as error:  # rosbags and its database raise whatever damaged bytes lead to
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path} is no rosbag2 recording that can be read: {reason}") from error


def _connection(known: "BagConnection") -> Connection:
    from rosbags.interfaces import MessageDefinitionFormat

    idl = known.msgdef.format is MessageDefinitionFormat.IDL
    return Connection(
        known.topic, known.msgtype, known.msgdef.data, "ros2idl" if idl else "ros2msg"
    )
