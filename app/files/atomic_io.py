"""Atomic writes: a file or a folder appears complete under its name, or not at all.

Everything is written to a temporary folder on the same file system and renamed into place.
"""

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from app.geometry import InputError, MarginGuardError

_PREFIX = ".partial-"


@contextmanager
def writing(path: Path, error: type[MarginGuardError] = InputError) -> Iterator[None]:
    """Raise ``error``, which names ``path``, for an `OSError` of the body."""
    try:
        yield
    except OSError as problem:
        raise error(f"{path} cannot be written: {problem.strerror or problem}") from problem


@contextmanager
def atomic_file(path: Path, error: type[MarginGuardError] = InputError) -> Iterator[Path]:
    """Yield a temporary path of the same name; its file replaces ``path`` when the body succeeds.

    When the body raises, ``path`` stays as it was. An `OSError`, of the body too, becomes
    ``error``.
    """
    with writing(path, error), _temporary_folder(path.absolute().parent) as temporary:
        partial = Path(temporary) / path.name
        yield partial
        partial.replace(path)


def write_file(path: Path, content: bytes) -> None:
    """Write ``content`` to ``path``; replace an earlier file. Raises `InputError` on failure."""
    with atomic_file(path) as partial:
        partial.write_bytes(content)


def write_durably(path: Path, content: bytes, error: type[MarginGuardError] = InputError) -> None:
    """Write ``content`` to ``path`` so that it survives a crash and a power failure.

    At every moment ``path`` is the earlier file or the complete new one. ``path`` has one writer at
    a time: the temporary file beside it has a fixed name, and a killed writer leaves one at most.
    """
    partial = path.with_name(f"{path.name}.new")
    with writing(path, error):
        descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(descriptor)
        partial.replace(path)
        # The new name is durable once the folder is.
        folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def write_files(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write several files, by name, into ``folder``; create the folder where it is missing.

    Earlier files of these names are replaced once every new one is complete. Raises `OSError`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    # Inside the folder, so that a rename does not cross file systems.
    with _temporary_folder(folder) as temporary:
        for name, content in contents.items():
            (Path(temporary) / name).write_bytes(content)
        for name in contents:
            (Path(temporary) / name).replace(folder / name)


@contextmanager
def new_folder(folder: Path, *, may_be_empty: bool = False) -> Iterator[Path]:
    """Yield a temporary folder that becomes ``folder`` when the body succeeds.

    When the body raises, nothing is left. Raises `InputError` where ``folder`` already exists (an
    empty folder is accepted with ``may_be_empty``) and where it cannot be written.
    """
    if os.path.lexists(folder) and not (may_be_empty and _is_empty_folder(folder)):
        expected = "; expected a new or an empty folder" if may_be_empty else ""
        raise InputError(f"{folder} already exists; refusing to overwrite it{expected}")
    parent = folder.absolute().parent
    with ExitStack() as stack:
        with writing(folder):
            with suppress(FileExistsError):
                parent.mkdir(parents=True)
            partial = Path(stack.enter_context(_temporary_folder(parent))) / folder.absolute().name
            partial.mkdir()
        try:
            yield partial
            partial.rename(folder)
        except OSError as error:
            raise InputError(f"{folder} cannot be written: {error}") from error


@contextmanager
def staging_folder(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder in ``folder``, which is created; `install_folder` takes from it.

    Nothing is left of it, nor of a created ``folder`` that is still empty. Raises `InputError`.
    """
    created = not folder.exists()
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        staging = _temporary_folder(folder)
    try:
        with staging as path:
            yield Path(path)
    finally:
        if created and _is_empty_folder(folder):
            folder.rmdir()


def install_folder(staging: Path, name: str, *, keep: bool) -> None:
    """Move the folder ``name`` of a `staging_folder` to its place; remove an earlier one.

    Without ``keep`` the earlier one is removed alone. Raises `OSError`.
    """
    place = staging.parent / name
    if place.is_dir():
        place.rename(staging / f"earlier-{name}")  # removed with the staging folder
    if keep:
        (staging / name).rename(place)


def check_output_path(path: Path, error: type[MarginGuardError] = InputError) -> None:
    """Raise ``error`` unless a file can be written to ``path``; call it before long work."""
    if path.is_dir() or not path.parent.is_dir():
        problem = "is a directory" if path.is_dir() else "parent directory does not exist"
        raise error(f"{path} cannot be written: {problem}")
    with writing(path, error), tempfile.TemporaryFile(dir=path.parent):
        pass


def _is_empty_folder(folder: Path) -> bool:
    return folder.is_dir() and not folder.is_symlink() and not any(folder.iterdir())


def _temporary_folder(parent: Path) -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix=_PREFIX, dir=parent, ignore_cleanup_errors=True)
