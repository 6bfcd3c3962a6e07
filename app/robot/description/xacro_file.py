"""``.xacro`` files to URDF, by the xacro package, kept to files of the description's own.

xacro evaluates Python expressions (``${...}``, ``$(eval ...)``). It hides the builtins from them,
but that is no prison: a xacro file is code, to be run by whoever trusts it. So only a file that the
user names is expanded, never a text from the network. What can be bounded is: included files,
``xacro.load_yaml`` too, must lie in the folder that holds the file's package (its own folder where
there is none) or in a package's folder, links followed, and document types are refused.
"""

import errno
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.parsers.expat import ExpatError

import xacro
import xacro.substitution_args

from app.files.bounded_io import read_bounded
from app.files.xml_guard import read_xml
from app.robot.errors import UrdfError

MAX_FILE_BYTES = 16 * 1024 * 1024

FindPackage = Callable[[str], Path | None]

_one_at_a_time = threading.Lock()  # xacro keeps its state in its modules


def parse_xacro_args(entries: list[str]) -> dict[str, str]:
    """``["name:=value", ...]`` to a mapping; `UrdfError` for what is written otherwise."""
    arguments: dict[str, str] = {}
    for entry in entries:
        name, sign, value = entry.partition(":=")
        if not sign or not name.strip():
            raise UrdfError(f"xacro argument {entry!r}: name:=value wanted")
        arguments[name.strip()] = value
    return arguments


def expand_xacro(path: Path, arguments: Mapping[str, str], find_package: FindPackage) -> bytes:
    """The URDF that the xacro file at ``path`` stands for.

    ``arguments`` are the values of its ``<xacro:arg>``; ``find_package`` answers ``$(find NAME)``.
    Raises `UrdfError` for whatever the expansion trips over.
    """
    reader = _Reader(path, find_package)
    with _one_at_a_time, _kept_to(reader):
        try:
            document = xacro.process_file(str(path), mappings=dict(arguments), verbosity=0)
            text: str = document.toxml()
        except UrdfError:
            raise
        except (xacro.XacroException, ExpatError) as problem:
            raise UrdfError(f"{path} cannot be expanded: {_words(problem)}") from problem
        except Exception as problem:  # an expression of the file raises whatever it likes
            kind = type(problem).__name__
            raise UrdfError(f"{path} cannot be expanded: {kind}: {_words(problem)}") from problem
    return text.encode()


class _Reader:
    """Opens the files that an expansion asks for, where they are allowed."""

    def __init__(self, path: Path, find_package: FindPackage) -> None:
        folder = path.resolve().parent
        above = (
            parent for parent in (folder, *folder.parents) if (parent / "package.xml").exists()
        )
        self._folders = [next(above, folder)]
        self._find_package = find_package

    def open(self, name: str) -> BytesIO:
        path = Path(name)
        if not any(path.resolve().is_relative_to(folder) for folder in self._folders):
            allowed = ", ".join(map(str, self._folders))
            raise UrdfError(f"xacro file {path} is outside the allowed folders: {allowed}")
        if not path.is_file():  # an optional include may be missing
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
        if path.suffix.lower() in (".yaml", ".yml"):
            return BytesIO(read_bounded(path, MAX_FILE_BYTES, UrdfError))
        return BytesIO(read_xml(path, UrdfError, max_bytes=MAX_FILE_BYTES))

    def find(self, package: str) -> str:
        folder = self._find_package(package)
        if folder is None:
            raise UrdfError(f"$(find {package}): no such package, name its folder in package_dirs")
        self._folders.append(folder.resolve())
        return str(folder)


@contextmanager
def _kept_to(reader: _Reader) -> Iterator[None]:
    """Answer in place of the builtin ``open`` and of an installed ROS, which xacro asks."""
    module: Any = xacro
    find = xacro.substitution_args._eval_find
    module.open = reader.open
    xacro.substitution_args._eval_find = reader.find
    try:
        yield
    finally:
        del module.open
        xacro.substitution_args._eval_find = find


def _words(problem: Exception) -> str:
    return " ".join(str(problem).split())
