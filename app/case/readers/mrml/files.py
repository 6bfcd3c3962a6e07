"""The files of an MRML scene: in its folder, or in its bundle, which is not unpacked to disk."""

import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import IO, Protocol

from app.files.bounded_io import open_for_reading
from app.files.paths import resolve_inside
from app.geometry import InputError, MarginGuardError

_MAX_SCENE_BYTES = 128_000_000
"""Limit on all scenes of one recording together: the sequences of a scene are read side by side."""
_MAX_RATIO = 256
_FREE_BYTES = 16_000_000
"""All files of sequences in one bundle unpack to `_MAX_RATIO` times its size, and this, at most."""
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Compression of bundles of 3D Slicer; `zipfile` unpacks the others without a limit."""
_MAX_MEMBERS = 20_000
_CHUNK_BYTES = 1_000_000
_DAMAGE = (zipfile.BadZipFile, zlib.error, struct.error, EOFError, ValueError, RuntimeError)
"""Errors of `zipfile` for damaged bytes, passwords and unknown compression methods."""


class _Budget:
    """Bytes that may still be read into memory for the scenes of one recording."""

    def __init__(self) -> None:
        self._left_bytes = _MAX_SCENE_BYTES

    def read(self, file: IO[bytes], where: str) -> bytes:
        """Read all of ``file``; `InputError` where it exceeds the budget."""
        content = file.read(self._left_bytes + 1)
        if len(content) > self._left_bytes:
            raise InputError(
                f"{where}: the scenes of a recording are too large; expected "
                f"{_MAX_SCENE_BYTES} bytes or less"
            )
        self._left_bytes -= len(content)
        return content


class MrmlFiles(Protocol):
    """A scene file and the files that it names; ``where`` names it in messages."""

    where: str
    budget: _Budget

    def scene(self) -> bytes:
        """Read the scene itself."""
        ...

    def open(self, name: str) -> AbstractContextManager[IO[bytes]]:
        """Open a file that the scene names."""
        ...


@contextmanager
def open_mrml(path: Path) -> Iterator[MrmlFiles]:
    """Open the scene at ``path``; `InputError` where it cannot be read or is damaged."""
    if path.suffix.lower() == ".mrb":
        with (
            open_for_reading(path) as file,
            _Bundle.opened(file, str(path), _Budget()) as bundle,
        ):
            yield bundle
    else:
        yield _Folder(path)


@contextmanager
def open_inner(files: MrmlFiles, file: IO[bytes], name: str, where: str) -> Iterator[MrmlFiles]:
    """Open the scene in ``file``, ``name`` of ``files``; by its ending a scene or a bundle."""
    content = files.budget.read(file, where)
    if name.lower().endswith(".mrb"):
        with _Bundle.opened(BytesIO(content), where, files.budget) as bundle:
            yield bundle
    else:
        yield _Inner(files, content, PurePosixPath(name).parent, where)


class _Inner:
    """A scene that is a file of another scene, in whose folder its own files are."""

    def __init__(self, files: MrmlFiles, content: bytes, folder: PurePosixPath, where: str) -> None:
        self.where = where
        self.budget = files.budget
        self._files, self._content, self._folder = files, content, folder

    def scene(self) -> bytes:
        return self._content

    def open(self, name: str) -> AbstractContextManager[IO[bytes]]:
        return self._files.open(str(self._folder / name))


class _Folder:
    """An ``.mrml`` file; the files that it names may not be outside its folder."""

    def __init__(self, path: Path) -> None:
        self.where = str(path)
        self.budget = _Budget()
        self._path = path

    def scene(self) -> bytes:
        with open_for_reading(self._path) as file:
            return self.budget.read(file, self.where)

    @contextmanager
    def open(self, name: str) -> Iterator[IO[bytes]]:
        path = resolve_inside(self._path.parent, name, f"{self.where}: the file of a sequence")
        with open_for_reading(path) as file:
            yield file


class _Bundle:
    """A ZIP file with one scene; its members are streamed and never unpacked to disk."""

    def __init__(self, bundle: zipfile.ZipFile, where: str, budget: _Budget, size: int) -> None:
        self.where = where
        self.budget = budget
        self._zip = bundle
        self._left_bytes = _FREE_BYTES + _MAX_RATIO * size
        names = bundle.namelist()
        scenes = [PurePosixPath(name) for name in names if name.lower().endswith(".mrml")]
        # A sequence may be an .mrml file too, in a deeper folder.
        top = min((len(path.parts) for path in scenes), default=0)
        self._scenes = [path for path in scenes if len(path.parts) == top]
        if len(self._scenes) != 1:
            raise InputError(f"{where} has {len(self._scenes)} scenes (.mrml); expected 1")

    @classmethod
    @contextmanager
    def opened(cls, file: IO[bytes], where: str, budget: _Budget) -> Iterator["_Bundle"]:
        with _damage_reported(where), zipfile.ZipFile(file) as bundle:
            if len(bundle.filelist) > _MAX_MEMBERS:
                raise InputError(
                    f"{where} has {len(bundle.filelist)} files; expected {_MAX_MEMBERS} or less"
                )
            methods = {info.compress_type for info in bundle.filelist}
            if not methods <= set(_METHODS):
                raise InputError(f"{where} holds files that are not deflated; expected a .mrb file")
            yield cls(bundle, where, budget, file.seek(0, 2))

    def scene(self) -> bytes:
        name = str(self._scenes[0])
        with self._zip.open(name) as file:
            return self.budget.read(file, f"{self.where}: {name}")

    @contextmanager
    def open(self, name: str) -> Iterator[IO[bytes]]:
        member = str(self._scenes[0].parent / name)
        if member not in self._zip.NameToInfo:
            raise InputError(f"{self.where} has no file {member!r}, which holds a sequence")
        size = self._zip.getinfo(member).file_size
        if size > self._left_bytes:
            raise InputError(
                f"{self.where}: {member} unpacks to {size} bytes; "
                f"expected {self._left_bytes} or less"
            )
        self._left_bytes -= size
        with _damage_reported(self.where), self._zip.open(member) as file:
            yield file
            while file.read(_CHUNK_BYTES):  # zipfile compares the checksum at the end only
                pass


@contextmanager
def _damage_reported(where: str) -> Iterator[None]:
    try:
        yield
    except MarginGuardError:
        raise
    except _DAMAGE as error:
        raise InputError(
            f"{where} is not a complete bundle: {error or type(error).__name__}"
        ) from error
