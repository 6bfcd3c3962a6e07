"""Tracker frames of MCAP files and rosbag2 folders.

``/tracked_transforms`` carries samples with their status. ``/tf`` is used for the edges that are
not on it: an edge belongs to ``/tracked_transforms`` from its first sample there on. ``/tf_static``
is not read because it holds no measurements. Message types come from the recording itself.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from app.case.frames.assembly import FrameAssembler
from app.case.frames.samples import TrackingFrame
from app.case.messages.decoder import message_decoder
from app.case.messages.ros_messages import (
    JOINT_STATE,
    TF_MESSAGE,
    TF_TOPIC,
    TIME_REFERENCE,
    TRACKED_TRANSFORM,
    TRACKED_TRANSFORMS_TOPIC,
    UNFILTERED_TIME_TOPIC,
)
from app.case.messages.values import JointValues, PoseValues, TimeValues
from app.case.readers.recording_format import Note
from app.case.readers.rosbag2.bag import read_bag
from app.case.readers.rosbag2.messages import Connection, RawMessage
from app.geometry import InputError, MarginGuardError, Stamp

_UNUSABLE = (MarginGuardError, AttributeError, TypeError, ValueError, OverflowError)
"""What a message raises that cannot be used; its type may have fields of other types."""

_MAX_DEFINITION_CHARS = 32 * 1024
"""Of all definitions that are used in a recording; four real ones have 12 thousand."""

_MAX_UNREADABLE = 10_000
"""A topic with more unreadable messages, and more of them than readable ones, is not read on."""


def read_mcap(
    path: Path, note: Note, *, joint_states_topic: str | None, offset_ns: int = 0
) -> Iterator[TrackingFrame]:
    """Yield the frames of an MCAP file or rosbag2 folder, ordered by acquisition stamp.

    Joint stamps are moved to the tracker's clock: tracker = robot + ``offset_ns``. Cut, damaged and
    unreadable parts are skipped and reported to ``note``. Raises `InputError` when the recording
    holds no tracked transform at all.
    """
    frames = 0
    for frame in _FrameReader(path, note, joint_states_topic, offset_ns).frames(
        read_bag(path, note)
    ):
        frames += 1
        yield frame
    if not frames:
        raise InputError(
            f"{path} holds no readable sample on {TRACKED_TRANSFORMS_TOPIC} or {TF_TOPIC}"
        )


class _FrameReader:
    """Turns the messages of one recording into frames; for one pass."""

    def __init__(
        self, path: Path, note: Note, joint_states_topic: str | None, offset_ns: int
    ) -> None:
        self._path = path
        self._note = note
        self._offset_ns = offset_ns
        self._assembler = FrameAssembler(note)
        self._tracked_edges: set[tuple[str, str]] = set()
        self._unreadable: Counter[str] = Counter()
        self._readable: Counter[str] = Counter()
        self._decoders: dict[tuple[str, bytes], Callable[[bytes], Any] | InputError] = {}
        self._definition_chars = 0
        self._uses: dict[str, tuple[str, Callable[[Any], Iterable[TrackingFrame]]]] = {
            TRACKED_TRANSFORMS_TOPIC: (TRACKED_TRANSFORM, self._add_tracked),
            TF_TOPIC: (TF_MESSAGE, self._add_tf),
            UNFILTERED_TIME_TOPIC: (TIME_REFERENCE, self._add_unfiltered),
        }
        if joint_states_topic is not None:
            self._uses[joint_states_topic] = (JOINT_STATE, self._add_joints)
        self._handlers: dict[Connection, Callable[[bytes], Iterable[TrackingFrame]]] = {}

    def frames(self, messages: Iterator[RawMessage]) -> Iterator[TrackingFrame]:
        for connection, data, _, _, _ in messages:
            handle = self._handlers.get(connection)
            if handle is None:
                handle = self._handlers[connection] = self._handler(connection)
            try:
                yield from handle(data)
            # A type with the known name may have fields of other types.
            except (
                MarginGuardError,
                AttributeError,
                TypeError,
                ValueError,
                OverflowError,
            ) as error:
                self._skip(connection.topic, error)
        yield from self._assembler.flush()
        for topic, count in self._unreadable.items():
            if count > 1:
                self._note(f"{count} messages on {topic} were skipped in all")

    def _handler(self, connection: Connection) -> Callable[[bytes], Iterable[TrackingFrame]]:
        """Adds a message of ``connection`` and returns the frames that are complete then."""
        expected_type, add = self._uses.get(connection.topic, ("", None))
        if add is None or connection.message_encoding != "cdr":
            return lambda data: ()
        if connection.message_type != expected_type:
            raise InputError(
                f"{self._path}: topic {connection.topic} carries {connection.message_type}; "
                f"expected {expected_type}"
            )

        return lambda data: self._read(connection, data, add)

    def _read(
        self,
        connection: Connection,
        data: bytes,
        add: Callable[[Any], Iterable[TrackingFrame]],
    ) -> Iterable[TrackingFrame]:
        topic = connection.topic
        if self._unreadable[topic] > max(_MAX_UNREADABLE, self._readable[topic]):
            self._unreadable[topic] += 1
            return ()
        values = self._decoder(connection)(data)
        self._readable[topic] += 1
        return add(values)

    def _decoder(self, connection: Connection) -> Callable[[bytes], Any]:
        """The decoder of a definition, made once; raises `InputError` for an unusable one."""
        key = (connection.message_type, connection.schema)
        if key not in self._decoders:
            self._decoders[key] = self._new_decoder(connection)
        found = self._decoders[key]
        if isinstance(found, InputError):
            raise found
        return found

    def _new_decoder(self, connection: Connection) -> Callable[[bytes], Any] | InputError:
        self._definition_chars += len(connection.schema)
        if self._definition_chars > _MAX_DEFINITION_CHARS:
            return InputError(
                f"the definitions of the recording have {self._definition_chars} characters or "
                f"more; expected {_MAX_DEFINITION_CHARS} or less"
            )
        try:
            return message_decoder(
                connection.message_type,
                connection.definition,
                idl=connection.schema_encoding == "ros2idl",
            )
        except InputError as error:
            return error

    def _skip(self, topic: str, error: Exception) -> None:
        self._unreadable[topic] += 1
        if self._unreadable[topic] == 1:
            self._note(f"a message on {topic} cannot be used and is skipped: {error}")

    def _add_tracked(self, values: PoseValues) -> Iterable[TrackingFrame]:
        self._tracked_edges.add(values.edge)
        return self._assembler.add_pose(values.sample())

    def _add_tf(self, poses: tuple[PoseValues, ...]) -> Iterable[TrackingFrame]:
        for values in poses:
            if values.edge not in self._tracked_edges:
                yield from self._assembler.add_pose(values.sample())

    def _add_unfiltered(self, values: TimeValues) -> Iterable[TrackingFrame]:
        self._assembler.add_unfiltered(Stamp(values.ns), Stamp(values.unfiltered_ns))
        return ()

    def _add_joints(self, values: JointValues) -> Iterable[TrackingFrame]:
        self._assembler.add_joints(values.sample(offset_ns=self._offset_ns))
        return ()
