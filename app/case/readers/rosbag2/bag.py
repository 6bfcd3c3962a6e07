"""The messages of a bag: one MCAP file, or a rosbag2 folder of MCAP files or of a database."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from app.case.readers.rosbag2.mcap_file import Connection, RawMessage, read_mcap_messages
from app.geometry import InputError

if TYPE_CHECKING:
    from rosbags.interfaces import Connection as BagConnection


def read_bag(path: Path, note: Callable[[str], None]) -> Iterator[RawMessage]:
    """Yield the messages of the file or folder ``path``; `InputError` where it cannot be read."""
    if path.is_file():
        yield from read_mcap_messages(path, note)
        return
    # rosbag2 numbers the parts of a bag: _2 comes before _10. metadata.yaml is missing after a
    # crash, so it is not used.
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
    except Exception as error:  # damaged bytes raise anything here
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path} is not a readable rosbag2 recording: {reason}") from error


def _connection(known: "BagConnection") -> Connection:
    from rosbags.interfaces import MessageDefinitionFormat

    idl = known.msgdef.format is MessageDefinitionFormat.IDL
    return Connection(
        known.topic, known.msgtype, known.msgdef.data, "ros2idl" if idl else "ros2msg"
    )
