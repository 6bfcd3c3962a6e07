"""Copies the messages of a recording, byte for byte, to a complete MCAP file with an index."""

import os
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from mcap.writer import CompressionType, Writer

from app.case.messages.ros_messages import ros_types
from app.case.readers.recording_format import note_to
from app.case.readers.registry import format_of
from app.case.readers.rosbag2.messages import Connection, RawMessage
from app.files.atomic_io import atomic_file
from app.geometry import InputError

_CHUNK_BYTES = 1024 * 1024


def write_messages(path: Path, messages: Iterable[RawMessage]) -> dict[str, int]:
    """Write ``messages`` in their order to the new file ``path``; returns their number by topic.

    Topics, types, definitions, metadata of channels, times and sequence numbers are kept. A type
    without a definition in the recording gets that of ROS 2 Jazzy, an unknown one none. The same
    messages give the same bytes. Raises `OSError`.
    """
    counts: Counter[str] = Counter()
    with path.open("xb") as file:
        writer = Writer(file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="marginguard")
        channels = _Channels(writer)
        for message in messages:
            writer.add_message(
                channels.number_of(message.connection), message.log_ns, message.data,
                message.publish_ns, message.sequence,
            )  # fmt: skip
            counts[message.connection.topic] += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return dict(counts)


def recover_recording(source: Path, path: Path) -> tuple[Mapping[str, int], tuple[str, ...]]:
    """Copy all intact messages of ``source``, an MCAP file or rosbag2 folder, to the file ``path``.

    ``path`` must not exist; ``source`` is not changed. Returns the number of messages by topic, and
    notes about skipped parts. Raises `InputError` for another format, a recording without an intact
    message, and a file that cannot be written; no file is left then.
    """
    if os.path.lexists(path):
        raise InputError(f"{path} already exists; refusing to overwrite it")
    messages = format_of(source).messages
    if messages is None:
        raise InputError(f"{source} has no messages to recover; expected .mcap or a rosbag2 folder")
    notes: list[str] = []
    with atomic_file(path) as partial:
        counts = write_messages(partial, messages(source, note_to(notes)))
        if not counts:
            raise InputError(f"{source} holds no intact message")
    return counts, tuple(notes)


class _Channels:
    """The channels of the file that ``writer`` writes."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        # The parts of a split bag repeat its channels.
        self._channels: dict[tuple[object, ...], int] = {}
        self._numbers: dict[Connection, int] = {}

    def number_of(self, connection: Connection) -> int:
        """Number of the channel of ``connection``; written before its first message."""
        number = self._numbers.get(connection)
        if number is None:
            number = self._numbers[connection] = self._channel(connection)
        return number

    def _channel(self, connection: Connection) -> int:
        schema = self._schema(connection)
        metadata = dict(connection.metadata)
        key = (
            connection.topic, schema, connection.message_encoding, tuple(sorted(metadata.items()))
        )  # fmt: skip
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(
                connection.topic, connection.message_encoding, schema, metadata
            )
        return self._channels[key]

    def _schema(self, connection: Connection) -> int:
        encoding, data = connection.schema_encoding, connection.schema
        if not data and connection.message_type in ros_types().fielddefs:
            text, _ = ros_types().generate_msgdef(connection.message_type, ros_version=2)
            encoding, data = "ros2msg", text.encode()
        if not (connection.message_type or data):
            return 0  # a channel without a schema
        key = (connection.message_type, encoding, data)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(*key)
        return self._schemas[key]
