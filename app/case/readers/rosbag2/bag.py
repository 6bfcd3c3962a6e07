"""The messages of a bag: one MCAP file, or a rosbag2 folder of MCAP files or of databases."""

from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from app.case.readers.rosbag2.database_file import read_database
from app.case.readers.rosbag2.mcap_file import read_mcap_runs
from app.case.readers.rosbag2.messages import (
    MAX_RUN_BYTES,
    MAX_RUN_MESSAGES,
    Connection,
    MessageRun,
    RawMessage,
    RunMessage,
)
from app.files.bounded_io import is_folder
from app.geometry import InputError

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
