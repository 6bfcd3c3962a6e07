"""Serialised messages, which the readers of bags yield, each with its topic and its times."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, TypeAlias

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
