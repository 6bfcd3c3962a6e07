"""The messages of an MCAP file in the file's order, from a file that may be cut or damaged."""

from collections.abc import Callable, Iterator
from pathlib import Path

from mcap.records import Channel, Schema

from app.case.readers.rosbag2.mcap_records import MAGIC, read_records, read_records_from
from app.case.readers.rosbag2.messages import (
    MAX_CONNECTIONS,
    MAX_DEFINITION_BYTES,
    Connection,
    MessagePlace,
    MessageRun,
    RawMessage,
)
from app.files.bounded_io import open_for_reading
from app.geometry import InputError

_MAX_SCHEMAS = 2048
_MAX_SCHEMA_BYTES = 64 * MAX_DEFINITION_BYTES
_NO_SCHEMA = Schema(id=0, data=b"", encoding="", name="")


def read_mcap_messages(path: Path, note: Callable[[str], None]) -> Iterator[RawMessage]:
    """Yield the messages of ``path`` one by one; raises as `read_mcap_runs`."""
    for run in read_mcap_runs(path, note):
        yield from run.raw_messages()


def read_mcap_runs(path: Path, note: Callable[[str], None]) -> Iterator[MessageRun]:
    """Yield the messages of ``path`` in runs, which do not reach across damage that is noted.

    Raises `InputError` for a file that is not MCAP or exceeds a limit. A definition above
    `MAX_DEFINITION_BYTES` is left out and reported to ``note``.
    """
    with open_for_reading(path) as file:
        channels = _Channels(path.name, note)
        for record in read_records(file, path.name, note):
            if isinstance(record, list):
                yield MessageRun(channels.connections, record)
            elif isinstance(record, Schema):
                channels.add_schema(record)
            else:
                channels.add_channel(record)


def read_placed_messages(path: Path, topic: str) -> Iterator[tuple[MessagePlace, bytes]]:
    """Yield the messages of ``topic``, each with the place for `read_placed_message`."""
    with open_for_reading(path) as file:
        channels = _Channels(path.name, _ignored)
        start = end = len(MAGIC)
        counts: dict[int, int] = {}
        for record in read_records(file, path.name, _ignored):
            if file.tell() != end:  # another record or chunk of the file
                start, end = end, file.tell()
                counts.clear()
            if isinstance(record, list):
                for number, data, *_ in record:
                    index = counts[number] = counts.get(number, -1) + 1
                    connection = channels.connections.get(number)
                    if connection is not None and connection.topic == topic:
                        yield MessagePlace(start, number, index), data
            elif isinstance(record, Schema):
                channels.add_schema(record)
            else:
                channels.add_channel(record)


def read_placed_message(path: Path, place: MessagePlace) -> bytes:
    """Read one message again; raises `InputError` where the file has changed."""
    index = -1
    with open_for_reading(path) as file:
        file.seek(place.offset)
        for record in read_records_from(file, path.name, _ignored):
            for number, data, *_ in record if isinstance(record, list) else ():
                index += number == place.connection
                if number == place.connection and index == place.number:
                    return data
    raise InputError(f"{path} has changed: a message at byte {place.offset} is not there any more")


def _ignored(text: str) -> None:
    """Notes are those of the reader of poses."""


class _Channels:
    """The channels of one file. ``connections``: those read so far, by the channel's number."""

    def __init__(self, name: str, note: Callable[[str], None]) -> None:
        self.connections: dict[int, Connection] = {}
        self._name = name
        self._note = note
        self._schemas: dict[int, Schema] = {0: _NO_SCHEMA}
        self._distinct: dict[tuple[str, str, bytes], Schema] = {}
        self._left_bytes = _MAX_SCHEMA_BYTES
        # A recording may repeat its channels: the same channel gives the same connection.
        self._known: dict[tuple[object, ...], Connection] = {}

    def add_schema(self, schema: Schema) -> None:
        """Add or replace the schema of a number."""
        if len(schema.data) > MAX_DEFINITION_BYTES:
            self._note(
                f"{self._name}: the definition of {schema.name[:60]} has {len(schema.data)} bytes "
                f"and is not read; expected {MAX_DEFINITION_BYTES} or less"
            )
            schema = Schema(id=schema.id, data=b"", encoding="", name=schema.name)
        content = (schema.name, schema.encoding, schema.data)
        if content not in self._distinct:
            self._left_bytes -= len(schema.data)
        self._schemas[schema.id] = self._distinct.setdefault(content, schema)
        if len(self._distinct) > _MAX_SCHEMAS or self._left_bytes < 0:
            raise InputError(
                f"{self._name} defines too many message types; expected up to {_MAX_SCHEMAS} in "
                f"{_MAX_SCHEMA_BYTES} bytes"
            )

    def add_channel(self, channel: Channel) -> None:
        """Add or replace the channel of a number; without its schema it is not used."""
        schema = self._schemas.get(channel.schema_id)
        if schema is None:
            return
        pairs = tuple(sorted(channel.metadata.items()))
        # `_distinct` holds every schema, so that none gets the identity of another.
        key = (channel.topic, id(schema), channel.message_encoding, pairs)
        connection = self._known.get(key)
        if connection is None:
            connection = self._known[key] = Connection(
                channel.topic, schema.name, schema.data, schema.encoding,
                channel.message_encoding, dict(channel.metadata),
            )  # fmt: skip
        self.connections[channel.id] = connection
        if len(self._known) > MAX_CONNECTIONS:
            raise InputError(
                f"{self._name} has more than {MAX_CONNECTIONS} topics; "
                f"expected {MAX_CONNECTIONS} or fewer"
            )
