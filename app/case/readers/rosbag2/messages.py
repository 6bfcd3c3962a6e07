"""What the readers of bags yield: serialised messages, each with its topic and its times."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

MAX_MESSAGE_BYTES = 64 * 1024 * 1024
"""Maximum size of a message, of any other record and of an unpacked chunk."""

MAX_DEFINITION_BYTES = 1024 * 1024
"""Maximum size of the definition of one message type, with those of nested types."""

MAX_CONNECTIONS = 4096
"""Maximum number of different topics, types and definitions of a recording."""


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
