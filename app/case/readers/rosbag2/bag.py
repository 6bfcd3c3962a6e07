"""The messages of a bag: one MCAP file, or a rosbag2 folder of MCAP files or of databases."""

from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from app.case.readers.rosbag2.database_file import read_database
from app.case.readers.rosbag2.mcap_file import read_mcap_messages
from app.case.readers.rosbag2.messages import RawMessage
from app.files.bounded_io import is_folder
from app.geometry import InputError

_MAX_FILES = 10_000


def read_bag(path: Path, note: Callable[[str], None]) -> Iterator[RawMessage]:
    """Yield the messages of the file or folder ``path``; `InputError` where it cannot be read.

    ``metadata.yaml`` is not read: it is missing after a crash.
    """
    if not is_folder(path):
        yield from read_mcap_messages(path, note)
        return
    parts = _parts(path, ".mcap")
    read = read_mcap_messages if parts else read_database
    for part in parts or _databases(path):
        yield from read(part, note)


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
