"""Unpack a folder that a stranger has zipped, under limits, completely or not at all."""

import stat
import struct
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from app.files.atomic_io import new_folder
from app.geometry import InputError

MAX_UNPACKED_BYTES = 2 << 30
MAX_FILES = 2000
_MAX_NAME, _MAX_DEPTH = 200, 8
_CHUNK_BYTES = 1 << 20
_MAX_DIRECTORY_BYTES = 2 << 20
"""`zipfile` makes an object of each entry of the directory before it can be asked how many."""
_END, _END_BYTES, _LONGEST_COMMENT = b"PK\5\6", 22, (1 << 16) - 1
_END_64, _END_64_BYTES = b"PK\6\7", 20
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
DAMAGE = (zipfile.BadZipFile, zlib.error, struct.error, EOFError, ValueError, RuntimeError)
"""Errors of `zipfile` for damaged bytes, passwords and unknown compression methods."""


def unpack_folder(
    archive: Path, folder: Path, marker: str, *, max_bytes: int = MAX_UNPACKED_BYTES
) -> None:
    """Write the folder of ``archive`` that contains the file ``marker`` to the new ``folder``.

    ``marker`` is at the top, or in the only folder there. Only stored and deflated files with plain
    relative names are accepted: no links, no name twice. What is written is counted, whatever the
    archive states. Raises `InputError`; then nothing is left.
    """
    what = "archive"
    _check_directory(archive, what)
    try:
        with zipfile.ZipFile(archive) as opened:
            entries = _entries(opened, what)
            inner = _top(entries, marker, what)
            with new_folder(folder) as partial:
                left = max_bytes
                for path, entry in entries.items():
                    if inner is not None and path.parts[0] != inner:
                        continue
                    relative = path if inner is None else path.relative_to(inner)
                    left = _write(opened, entry, partial / relative, left, what)
    except DAMAGE as error:
        raise InputError(f"{what}: damaged ({error}); expected a zip file") from error


def _check_directory(archive: Path, what: str) -> None:
    """Read the size of the directory from the record at the end, as `zipfile` finds it."""
    with archive.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _END_BYTES - _LONGEST_COMMENT - _END_64_BYTES))
        tail = file.read()
    at = tail.rfind(_END)
    if at < 0 or at + _END_BYTES > len(tail):
        raise InputError(f"{what}: damaged (no directory at its end); expected a zip file")
    if tail[max(0, at - _END_64_BYTES) :].startswith(_END_64):
        raise InputError(f"{what}: in the format zip64; expected a zip file of less than 4 GiB")
    (directory,) = struct.unpack_from("<L", tail, at + 12)
    if directory > _MAX_DIRECTORY_BYTES:
        raise InputError(
            f"{what}: its directory has {directory} bytes; expected at most {MAX_FILES} files"
        )


def _entries(opened: zipfile.ZipFile, what: str) -> dict[PurePosixPath, zipfile.ZipInfo]:
    """The files by their paths; folders are made for them."""
    infos = opened.infolist()
    if len(infos) > MAX_FILES:
        raise InputError(f"{what}: {len(infos)} files; expected at most {MAX_FILES}")
    found: dict[PurePosixPath, zipfile.ZipInfo] = {}
    known: set[str] = set()
    for info in infos:
        if info.is_dir():
            continue
        path = _checked(info, what)
        if info.filename.lower() in known:
            raise InputError(f"{what}: has {info.filename[:80]!r} twice; expected each name once")
        known.add(info.filename.lower())
        found[path] = info
    return found


def _checked(info: zipfile.ZipInfo, what: str) -> PurePosixPath:
    name, path = info.filename, PurePosixPath(info.filename)
    mode = info.external_attr >> 16
    if (
        not name.isprintable()
        or len(name) > _MAX_NAME
        or "\\" in name
        or ":" in name
        or path.is_absolute()
        or len(path.parts) > _MAX_DEPTH
        or any(part in ("", ".", "..") or part.startswith(".") for part in name.split("/"))
    ):
        raise InputError(
            f"{what}: has the name {name[:80]!r}; expected a relative path without '..', hidden "
            f"names, '\\' and ':', of at most {_MAX_NAME} characters and {_MAX_DEPTH} folders"
        )
    if stat.S_IFMT(mode) not in (0, stat.S_IFREG):
        raise InputError(f"{what}: {name[:80]!r} is a link or a device; expected regular files")
    if info.compress_type not in _METHODS or info.flag_bits & 1:
        raise InputError(
            f"{what}: {name[:80]!r} is compressed by another method or encrypted; expected stored "
            "and deflated files"
        )
    return path


def _top(entries: dict[PurePosixPath, zipfile.ZipInfo], marker: str, what: str) -> str | None:
    """The folder that contains ``marker``; None for the top."""
    if PurePosixPath(marker) in entries:
        return None
    tops = {path.parts[0] for path in entries if path.name == marker and len(path.parts) == 2}
    if len(tops) != 1:
        raise InputError(f"{what}: {len(tops)} folders with a {marker}; expected one case")
    return tops.pop()


def _write(
    opened: zipfile.ZipFile, entry: zipfile.ZipInfo, target: Path, left: int, what: str
) -> int:
    """Unpack a file; return how many bytes may still be written."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with opened.open(entry) as source, target.open("xb") as file:
        while data := source.read(_CHUNK_BYTES):
            left -= len(data)
            if left < 0:
                raise InputError(f"{what}: too large when unpacked; expected a smaller case")
            file.write(data)
    return left
