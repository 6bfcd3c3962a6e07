"""Tracker frames of MCAP files and rosbag2 folders.

``/tracked_transforms`` carries samples with their status. ``/tf`` is used for the edges that are
not on it: an edge belongs to ``/tracked_transforms`` from its first sample there on. ``/tf_static``
is not read because it holds no measurements. Message types come from the recording itself.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from app.case.frame_streams import Activation, ActivationTrail, FrameAssembler, TrackingFrame
from app.case.messages.cdr_batch import Batch, joint_samples, tf_samples, tracked_samples
from app.case.messages.decoder import MessageDecoder, message_decoder
from app.case.messages.message_values import JointValues, PoseValues, TimeValues
from app.case.messages.ros_messages import (
    BOOL,
    JOINT_STATE,
    TF_MESSAGE,
    TF_TOPIC,
    TIME_REFERENCE,
    TRACKED_TRANSFORM,
    TRACKED_TRANSFORMS_TOPIC,
    UNFILTERED_TIME_TOPIC,
)
from app.case.readers.recording_format import Connection, MessageRun, Note, SideTopics
from app.case.readers.rosbag2.bag import read_bag_runs
from app.geometry import InputError, MarginGuardError, Stamp, TrackedTransform

_UNUSABLE = (MarginGuardError, AttributeError, TypeError, ValueError, OverflowError)
"""Errors raised by a message that cannot be used; its type may have fields of other types."""

_MAX_DEFINITION_CHARS = 32 * 1024
"""Limit on all used definitions of a recording; four real ones have 12 thousand characters."""

_MAX_UNREADABLE = 10_000
"""A topic with more unreadable messages, and more of them than readable ones, is not read on."""

_MIN_BATCH = 4
"""Fewer messages of one length are decoded one by one."""


def read_mcap(path: Path, note: Note, side: SideTopics) -> Iterator[TrackingFrame]:
    """Yield the frames of an MCAP file or rosbag2 folder, ordered by acquisition stamp.

    A frame has the activation at the receipt of its first sample. Cut, damaged and unreadable parts
    are skipped and reported to ``note``. Raises `InputError` when the recording holds no tracked
    transform at all.
    """
    frames = 0
    for frame in _FrameReader(path, note, side).frames(read_bag_runs(path, note)):
        frames += 1
        yield frame
    if not frames:
        raise InputError(
            f"{path} holds no readable sample on {TRACKED_TRANSFORMS_TOPIC} or {TF_TOPIC}"
        )


@dataclass(slots=True, eq=False)
class _Topic:
    """Use of one topic. ``add`` takes the values of one message, ``add_sample`` those of a batch.

    ``batch`` decodes many messages; None decodes them one by one.
    """

    name: str
    message_type: str
    add: Callable[[Any], Iterable[TrackingFrame]]
    batch: Batch | None = None
    add_sample: Callable[[Any], Iterable[TrackingFrame]] = field(default=lambda sample: ())
    readable: int = 0
    unreadable: int = 0

    @property
    def is_left_out(self) -> bool:
        """True if its messages are not read on."""
        return self.unreadable > max(_MAX_UNREADABLE, self.readable)


class _FrameReader:
    """Turns the messages of one recording into frames; for one pass.

    Messages of one connection and length in a run are decoded together, as far as they are good
    samples in a known layout. All are then used one after the other in their order.
    """

    def __init__(self, path: Path, note: Note, side: SideTopics) -> None:
        self._path = path
        self._note = note
        self._offset_ns = side.offset_ns
        self._received_ns = 0
        self._activation = (
            None if side.activation is None else ActivationTrail(side.activation_stale_after_ns)
        )
        self._assembler = FrameAssembler(note, None if side.activation is None else self._burns)
        self._tracked_edges: set[tuple[str, str]] = set()
        self._decoders: dict[tuple[str, bytes], MessageDecoder | InputError] = {}
        self._definition_chars = 0
        topics = [
            _Topic(
                TRACKED_TRANSFORMS_TOPIC,
                TRACKED_TRANSFORM,
                self._add_tracked,
                tracked_samples,
                self._add_tracked_sample,
            ),
            _Topic(
                TF_TOPIC,
                TF_MESSAGE,
                self._add_tf,
                # An edge that is tracked stays so: its transforms on /tf are not used any more.
                partial(tf_samples, unused=self._tracked_edges),
                self._add_tf_samples,
            ),
            _Topic(UNFILTERED_TIME_TOPIC, TIME_REFERENCE, self._add_unfiltered),
        ]
        if side.topic is not None:
            joints = partial(joint_samples, offset_ns=side.offset_ns)
            add_sample = self._assembler.add_joints
            topics.append(_Topic(side.topic, JOINT_STATE, self._add_joints, joints, add_sample))
        if side.activation is not None:
            topics.append(_Topic(side.activation, BOOL, self._add_activation))
        self._topics = {topic.name: topic for topic in topics}
        self._used: dict[Connection, _Topic | None] = {}
        self._skipped: list[_Topic] = []

    def frames(self, runs: Iterator[MessageRun]) -> Iterator[TrackingFrame]:
        for run in runs:
            yield from self._frames_of(run)
        yield from self._assembler.flush()
        for topic in self._skipped:
            if topic.unreadable > 1:
                self._note(f"{topic.unreadable} messages on {topic.name} were skipped in all")

    def _frames_of(self, run: MessageRun) -> Iterator[TrackingFrame]:
        alike: dict[tuple[int, int], list[int]] = {}
        for index, message in enumerate(run.messages):
            key = (message[0], len(message[1]))
            if key in alike:
                alike[key].append(index)
            else:
                alike[key] = [index]
        samples: list[Any] = [None] * len(run.messages)
        topics: dict[int, _Topic | None] = {}
        for index, (number, data, received_ns, _, _) in enumerate(run.messages):
            self._received_ns = received_ns
            sample = samples[index]
            if sample is not None:
                topic = topics[number]
                if topic is not None and topic.unreadable <= _MAX_UNREADABLE:
                    topic.readable += 1
                    finished = topic.add_sample(sample)
                    if finished:
                        yield from finished
                    continue
            connection = run.connections.get(number)
            if connection is None:
                continue
            topic = topics[number] = self._topic_of(connection)
            if topic is None:
                continue
            try:
                yield from self._read(topic, connection, data)
            # A type with the known name may have fields of other types.
            except _UNUSABLE as error:
                self._skip(topic, error)
            # Decoded after the first of them, which makes the decoder and learns the layout.
            indices = alike.pop((number, len(data)), ())
            decoder = self._decoders.get((connection.message_type, connection.schema))
            if (
                topic.batch is not None
                and len(indices) > _MIN_BATCH
                and isinstance(decoder, MessageDecoder)
            ):
                found = decoder.batch([run.messages[at][1] for at in indices], topic.batch)
                for at, sample in zip(indices, found, strict=True):
                    samples[at] = sample

    def _topic_of(self, connection: Connection) -> _Topic | None:
        """The topic of ``connection``; None where it is not used."""
        if connection in self._used:
            return self._used[connection]
        topic = self._topics.get(connection.topic)
        if topic is None or connection.message_encoding != "cdr":
            self._used[connection] = None
            return None
        if connection.message_type != topic.message_type:
            raise InputError(
                f"{self._path}: topic {connection.topic} carries {connection.message_type}; "
                f"expected {topic.message_type}"
            )
        self._used[connection] = topic
        return topic

    def _read(self, topic: _Topic, connection: Connection, data: bytes) -> Iterable[TrackingFrame]:
        if topic.is_left_out:
            topic.unreadable += 1
            return ()
        values = self._decoder(connection)(data)
        topic.readable += 1
        return topic.add(values)

    def _decoder(self, connection: Connection) -> MessageDecoder:
        """The decoder of a definition, made once; raises `InputError` for an unusable one."""
        key = (connection.message_type, connection.schema)
        if key not in self._decoders:
            self._decoders[key] = self._new_decoder(connection)
        found = self._decoders[key]
        if isinstance(found, InputError):
            raise found
        return found

    def _new_decoder(self, connection: Connection) -> MessageDecoder | InputError:
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

    def _skip(self, topic: _Topic, error: Exception) -> None:
        topic.unreadable += 1
        if topic.unreadable == 1:
            self._skipped.append(topic)
            self._note(f"a message on {topic.name} cannot be used and is skipped: {error}")

    def _add_tracked(self, values: PoseValues) -> Iterable[TrackingFrame]:
        self._tracked_edges.add(values.edge)
        return self._assembler.add_pose(values.sample())

    def _add_tracked_sample(self, sample: TrackedTransform) -> Iterable[TrackingFrame]:
        self._tracked_edges.add((sample.target, sample.source))
        return self._assembler.add_pose(sample)

    def _add_tf(self, poses: tuple[PoseValues, ...]) -> Iterable[TrackingFrame]:
        for values in poses:
            if values.edge not in self._tracked_edges:
                yield from self._assembler.add_pose(values.sample())

    def _add_tf_samples(self, samples: tuple[TrackedTransform, ...]) -> Iterable[TrackingFrame]:
        for sample in samples:
            if (sample.target, sample.source) not in self._tracked_edges:
                yield from self._assembler.add_pose(sample)

    def _add_unfiltered(self, values: TimeValues) -> Iterable[TrackingFrame]:
        self._assembler.add_unfiltered(Stamp(values.ns), Stamp(values.unfiltered_ns))
        return ()

    def _add_activation(self, on: bool) -> Iterable[TrackingFrame]:
        if self._activation is not None:
            self._activation.hear(on, self._received_ns)
        return ()

    def _burns(self) -> Activation:
        """The state of the energy device when the present message was received."""
        if self._activation is None:
            return Activation.UNKNOWN
        return self._activation.at(self._received_ns)

    def _add_joints(self, values: JointValues) -> Iterable[TrackingFrame]:
        return self._assembler.add_joints(values.sample(offset_ns=self._offset_ns))
