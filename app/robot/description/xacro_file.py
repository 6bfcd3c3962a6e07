"""``.xacro`` files to URDF by the xacro package, restricted to files of the description's packages.

xacro evaluates Python expressions (``${...}``, ``$(eval ...)``). It hides the builtins from them,
but this is not a sandbox: a xacro file is code. So only a file that the user names is expanded,
never a text from the network. Included files, those of ``xacro.load_yaml`` too, must lie, with
links followed, in the folder of the file's package (its own folder where it has none) or in that of
a package found by ``$(find ...)``. Document types are refused.
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

from app.files.bounded_io import is_file, read_bounded
from app.files.xml_guard import read_xml
from app.robot.errors import UrdfError

MAX_FILE_BYTES = 16 * 1024 * 1024

FindPackage = Callable[[str], Path | None]

_XACRO_LOCK = threading.Lock()  # xacro has module-level state


def parse_xacro_args(entries: list[str]) -> dict[str, str]:
    """Parse ``["name:=value", ...]``; raise `UrdfError` for an entry of another form."""
    arguments: dict[str, str] = {}
    for entry in entries:
        name, sign, value = entry.partition(":=")
        if not sign or not name.strip():
            raise UrdfError(f"xacro argument is {entry!r}; expected name:=value")
        arguments[name.strip()] = value
    return arguments


def expand_xacro(path: Path, arguments: Mapping[str, str], find_package: FindPackage) -> bytes:
    """Expand the xacro file at ``path`` to URDF.

    ``arguments`` are the values of its ``<xacro:arg>``. ``find_package`` resolves ``$(find NAME)``.
    Raises `UrdfError` when the expansion fails.
    """
    reader = _Reader(path, find_package)
    with _XACRO_LOCK, _restricted_to(reader):
        try:
            document = xacro.process_file(str(path), mappings=dict(arguments), verbosity=0)
            text: str = document.toxml()
        except UrdfError:
            raise
        except (xacro.XacroException, ExpatError) as problem:
            # xacro wraps an error of `_Reader` and repeats its text.
            cause = getattr(problem, "exc", None)
            reason = _one_line(cause if isinstance(cause, UrdfError) else problem)
            raise UrdfError(f"{path} cannot be expanded: {reason}") from problem
        except Exception as problem:  # expressions of the file raise exceptions of any type
            kind = type(problem).__name__
            raise UrdfError(f"{path} cannot be expanded: {kind}: {_one_line(problem)}") from problem
    return text.encode()


class _Reader:
    """Opens files for an expansion, if they are in an allowed folder."""

    def __init__(self, path: Path, find_package: FindPackage) -> None:
        folder = path.resolve().parent
        above = (parent for parent in (folder, *folder.parents) if is_file(parent / "package.xml"))
        self._folders = [next(above, folder)]
        self._find_package = find_package

    def open(self, name: str) -> BytesIO:
        path = Path(name)
        if not any(path.resolve().is_relative_to(folder) for folder in self._folders):
            allowed = ", ".join(map(str, self._folders))
            raise UrdfError(
                f"xacro file {path} is outside the allowed folders; expected one of {allowed}"
            )
        if not is_file(path):  # xacro ignores this error for an optional include
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
        if path.suffix.lower() in (".yaml", ".yml"):
            return BytesIO(read_bounded(path, MAX_FILE_BYTES, UrdfError))
        return BytesIO(read_xml(path, UrdfError, max_bytes=MAX_FILE_BYTES))

    def find(self, package: str) -> str:
        folder = self._find_package(package)
        if folder is None:
            raise UrdfError(f"$(find {package}): package not found; add its folder to package_dirs")
        self._folders.append(folder.resolve())
        return str(folder)


@contextmanager
def _restricted_to(reader: _Reader) -> Iterator[None]:
    """Replace the builtin ``open`` and the package search of an installed ROS in xacro."""
    module: Any = xacro
    find = xacro.substitution_args._eval_find
    module.open = reader.open
    xacro.substitution_args._eval_find = reader.find
    try:
        yield
    finally:
        del module.open
        xacro.substitution_args._eval_find = find


def _one_line(problem: Exception) -> str:
    return " ".join(str(problem).split())
