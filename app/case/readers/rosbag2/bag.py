"""The messages of a bag: one MCAP file, or a rosbag2 folder of MCAP files or of databases.

A database (``.db3``) is read with `sqlite3`, because it can bound the size of a value before it is
loaded, and the work of a query; rosbags reads values of any size. The database is hostile until
read: only plain tables with the columns of rosbag2 are queried, and no function or view of the file
is run.
"""

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import quote

import zstandard

from app.case.readers.recording_format import (
    MAX_CONNECTIONS,
    MAX_DEFINITION_BYTES,
    MAX_MESSAGE_BYTES,
    MAX_RUN_BYTES,
    MAX_RUN_MESSAGES,
    Connection,
    MessageRun,
    RawMessage,
    RunMessage,
)
from app.case.readers.rosbag2.mcap_file import read_mcap_runs
from app.files.bounded_io import is_folder, open_for_reading
from app.geometry import InputError

_MAGIC = b"SQLite format 3\0"
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""Begins a message of a bag that compresses each message; CDR begins with a zero."""

_STEPS = 100_000
_MAX_CALLS = 10
"""One row may take `_STEPS` times this many instructions of SQLite; a real one takes some tens."""

_DEFINITION_COLUMNS = ("topic_type", "encoding", "encoded_message_definition")
_TABLES = {
    "topics": ("id", "name", "type"),
    "messages": ("id", "topic_id", "timestamp", "data"),
    "message_definitions": _DEFINITION_COLUMNS,
}
_OPTIONAL_COLUMNS = ("serialization_format", "offered_qos_profiles", "type_description_hash")
_ALLOWED_ACTIONS = (sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ, sqlite3.SQLITE_PRAGMA)
_ALLOWED_FUNCTIONS = ("length", "substr")


def read_database(path: Path, note: Callable[[str], None]) -> Iterator[RawMessage]:
    """Yield the messages of ``path``; `InputError` for other content and for one out of bounds.

    Messages above `MAX_MESSAGE_BYTES` are skipped and reported to ``note``. Messages in a
    write-ahead log (``-wal``) of a killed recorder are not read, which is reported, too.
    """
    with open_for_reading(path) as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise InputError(f"{path} is not a readable rosbag2 recording: not a database")
    log = path.with_name(f"{path.name}-wal")
    if log.is_file() and log.stat().st_size:
        note(f"{log.name} is not read: the last messages of {path.name} are missing")
    try:
        with closing(_Database(path)) as database:
            yield from _messages(database, path.name, note)
    except (sqlite3.Error, ValueError, OverflowError, MemoryError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path} is not a readable rosbag2 recording: {reason}") from error


class _Database:
    """A read-only connection whose queries are bounded. Raises `sqlite3.Error`."""

    def __init__(self, path: Path) -> None:
        # immutable: the file may be on a read-only disk, and its recorder holds no lock on it.
        uri = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
        self._calls = 0
        self._connection = sqlite3.connect(uri, uri=True)
        self._connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_MESSAGE_BYTES + 1024)
        self._connection.execute("PRAGMA trusted_schema = OFF")
        self._connection.execute("PRAGMA cell_size_check = ON")
        self._connection.set_authorizer(_authorized)
        self._connection.set_progress_handler(self._is_too_long, _STEPS)

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def rows(self, query: str, values: tuple[object, ...] = ()) -> Iterator[tuple[Any, ...]]:
        """Yield the rows of ``query``; a row that takes too much work raises an error."""
        self._calls = 0
        for row in self._connection.execute(query, values):
            yield row
            self._calls = 0

    def columns(self, table: str) -> set[str]:
        """Stored columns of a table of the file; empty for a view, a virtual or a missing table."""
        plain = (
            "SELECT 1 FROM sqlite_master WHERE name = ? AND substr(sql, 1, 13) = 'CREATE TABLE '"
        )
        if not list(self.rows(plain, (table,))):
            return set()
        return {str(row[1]) for row in self.rows(f"PRAGMA table_xinfo({table})") if row[6] == 0}

    def _is_too_long(self) -> bool:
        self._calls += 1
        return self._calls > _MAX_CALLS


def _authorized(action: int, _: str | None, name: str | None, *__: object) -> int:
    if action == sqlite3.SQLITE_FUNCTION:
        return sqlite3.SQLITE_OK if name in _ALLOWED_FUNCTIONS else sqlite3.SQLITE_DENY
    return sqlite3.SQLITE_OK if action in _ALLOWED_ACTIONS else sqlite3.SQLITE_DENY


def _messages(database: _Database, name: str, note: Callable[[str], None]) -> Iterator[RawMessage]:
    for table in ("topics", "messages"):
        missing = set(_TABLES[table]) - database.columns(table)
        if missing:
            raise ValueError(f"table {table} lacks {', '.join(sorted(missing))}")
    connections = _connections(database)
    skipped = 0
    # In the order of recording, which needs no sorting.
    query = (
        "SELECT topic_id, timestamp, CASE WHEN length(data) <= ? THEN data END "
        "FROM messages ORDER BY rowid"
    )
    for sequence, (topic, ns, data) in enumerate(database.rows(query, (MAX_MESSAGE_BYTES,))):
        connection = connections.get(topic)
        if not isinstance(data, bytes):
            skipped += 1
        elif connection is not None and isinstance(ns, int):
            yield RawMessage(connection, _unpacked(data), ns, ns, sequence % 2**32)
    if skipped:
        note(
            f"{name}: {skipped} messages have no data or exceed {MAX_MESSAGE_BYTES} bytes: skipped"
        )


def _connections(database: _Database) -> dict[object, Connection]:
    """The topics by their number."""
    columns = database.columns("topics")
    optional = [each for each in _OPTIONAL_COLUMNS if each in columns]
    definitions = _definitions(database)
    found: dict[object, Connection] = {}
    for number, topic, kind, *values in database.rows(
        f"SELECT {', '.join((*_TABLES['topics'], *optional))} FROM topics ORDER BY rowid"
    ):
        known = dict(zip(optional, map(str, values), strict=True))
        if not (isinstance(topic, str) and isinstance(kind, str)):
            raise ValueError(f"topic {number} has no name or type")
        encoding, schema = definitions.get(kind, ("", b""))
        metadata = {
            "offered_qos_profiles": known.get("offered_qos_profiles", ""),
            "topic_type_hash": known.get("type_description_hash", ""),
        }
        message_encoding = known.get("serialization_format") or "cdr"
        found[number] = Connection(topic, kind, schema, encoding, message_encoding, metadata)
        if len(found) > MAX_CONNECTIONS:
            raise ValueError(f"more than {MAX_CONNECTIONS} topics")
    return found


def _definitions(database: _Database) -> dict[str, tuple[str, bytes]]:
    """Encoding and definition by message type; bags from before ROS 2 Iron have none."""
    if not set(_DEFINITION_COLUMNS) <= database.columns("message_definitions"):
        return {}
    found: dict[str, tuple[str, bytes]] = {}
    for kind, encoding, text in database.rows(
        f"SELECT {', '.join(_DEFINITION_COLUMNS)} FROM message_definitions "
        "WHERE length(encoded_message_definition) <= ?",
        (MAX_DEFINITION_BYTES,),
    ):
        if isinstance(kind, str) and isinstance(encoding, str) and isinstance(text, str):
            found[kind] = (encoding, text.encode())
        if len(found) > MAX_CONNECTIONS:
            raise ValueError(f"more than {MAX_CONNECTIONS} definitions")
    return found


def _unpacked(data: bytes) -> bytes:
    """The message; unpacked where the bag compresses each message."""
    if not data.startswith(_ZSTD_MAGIC):
        return data
    try:
        with zstandard.ZstdDecompressor().stream_reader(BytesIO(data)) as packed:
            unpacked = packed.read(MAX_MESSAGE_BYTES + 1)
    except zstandard.ZstdError as error:
        raise ValueError(f"a compressed message is damaged: {error}") from error
    if len(unpacked) > MAX_MESSAGE_BYTES:
        raise ValueError(f"a message unpacks to more than {MAX_MESSAGE_BYTES} bytes")
    return unpacked


_MAX_FILES = 10_000


def read_bag(path: Path, note: Callable[[str], None]) -> Iterator[RawMessage]:
    """Yield the messages of the file or folder ``path`` one by one; raises as `read_bag_runs`."""
    for run in read_bag_runs(path, note):
        yield from run.raw_messages()


def read_bag_runs(path: Path, note: Callable[[str], None]) -> Iterator[MessageRun]:
    """Yield the messages of the file or folder ``path`` in runs, in their order.

    ``metadata.yaml`` is not read: it is missing after a crash. Raises `InputError` where the
    recording cannot be read.
    """
    if not is_folder(path):
        yield from read_mcap_runs(path, note)
        return
    parts = mcap_parts(path)
    read = read_mcap_runs if parts else _database_runs
    for part in parts or _databases(path):
        yield from read(part, note)


def mcap_parts(folder: Path) -> list[Path]:
    """The MCAP files of a rosbag2 folder in their order; none for a bag in databases."""
    return _parts(folder, ".mcap")


def _database_runs(path: Path, note: Callable[[str], None]) -> Iterator[MessageRun]:
    """The messages of a database in runs; notes and errors keep their place among them."""
    held: list[str] = []

    def pass_on() -> None:
        for text in held:
            note(text)
        held.clear()

    messages = read_database(path, held.append)
    connections: dict[int, Connection] = {}
    numbers: dict[Connection, int] = {}
    ended = False
    while not ended:
        run: list[RunMessage] = []
        size = 0
        problem: Exception | None = None
        try:
            while len(run) < MAX_RUN_MESSAGES and size <= MAX_RUN_BYTES and not ended:
                message = next(messages, None)
                if message is None:
                    ended = True
                    break
                if not run:
                    pass_on()
                connection, data, log_ns, publish_ns, sequence = message
                number = numbers.setdefault(connection, len(numbers))
                connections[number] = connection
                run.append((number, data, log_ns, publish_ns, sequence))
                size += len(data)
        except Exception as error:  # after the messages that were read before it
            problem = error
        if run:
            yield MessageRun(connections, run)
        pass_on()
        if problem is not None:
            raise problem


def _databases(folder: Path) -> list[Path]:
    databases = _parts(folder, ".db3")
    if not databases:
        found = "; unpack its .db3.zstd files first (zstd -d)" if _parts(folder, ".zstd") else ""
        raise InputError(
            f"{folder} is not a readable rosbag2 recording: no .mcap and no .db3 file{found}"
        )
    return databases


def _parts(folder: Path, ending: str) -> list[Path]:
    """The files with ``ending``. rosbag2 numbers the parts of a bag: _2 comes before _10."""
    try:
        names = [each.name for each in islice(folder.iterdir(), _MAX_FILES + 1)]
    except OSError as error:
        raise InputError(f"{folder} cannot be read: {error.strerror or error}") from error
    if len(names) > _MAX_FILES:
        raise InputError(f"{folder} has more than {_MAX_FILES} files; expected a recording")
    found = [name for name in names if name.endswith(ending)]
    return [folder / name for name in sorted(found, key=lambda name: (len(name), name))]
