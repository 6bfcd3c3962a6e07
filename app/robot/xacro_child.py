"""Process that expands one xacro file, with limits of time, memory and files.

xacro evaluates Python expressions, which can take any time and memory (``10**10**8``), and macros
that call each other without end. Inside one process nothing can stop them, so they run here: the
standard input has a request as JSON, the standard output gets the URDF or the error. What xacro
prints is not read.
"""

import errno
import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.parsers.expat import ExpatError

import xacro
import xacro.substitution_args

from app.files.bounded_io import is_file, read_bounded
from app.files.child_process import answer_request, limit_this_process
from app.files.keys import did_you_mean
from app.files.xml_guard import read_xml
from app.robot.elements import UrdfError
from app.robot.mesh_locator import MeshLocator

MAX_FILE_BYTES = 16 * 1024 * 1024
MAX_MEMORY_BYTES = 512 * 1024 * 1024
"""Limit for the memory that an expansion adds to that of the interpreter."""

_UNDEFINED = re.compile(r"Undefined substitution argument (\S+)")
_PYTHON_CLASS = re.compile(r"<class '[\w.]+'>:? ?")


def answer(request: bytes) -> bytes:
    """Expand the file of the request; the reply is ``U`` and the URDF, or ``E`` and the error.

    Limits this process. It is ended by ``SIGPROF`` when its time is over.
    """
    values = json.loads(request)
    path = Path(values["path"])
    limit_this_process(values["max_cpu_s"], MAX_MEMORY_BYTES)
    try:
        locator = MeshLocator(path, values["package_dirs"])
        return b"U" + _expand(
            path, values["arguments"], _Reader(path, locator), values["max_bytes"]
        )
    except UrdfError as problem:
        return b"E" + str(problem).encode("utf-8", "replace")
    except MemoryError:
        return b"E" + (
            f"{path} cannot be expanded: it needs more than {MAX_MEMORY_BYTES >> 20} MiB"
        ).encode("utf-8", "replace")


def _expand(path: Path, arguments: dict[str, str], reader: "_Reader", max_bytes: int) -> bytes:
    values = _Arguments(arguments)
    with _restricted_to(reader):
        try:
            document = xacro.process_file(str(path), mappings=values, verbosity=0)
            # The lines of the program xacro, so that a message can name one of them.
            text = document.toprettyxml(indent="  ").encode()
        except (UrdfError, MemoryError):
            raise
        except (xacro.XacroException, ExpatError) as problem:
            # xacro wraps an error of `_Reader` and repeats its text.
            cause = getattr(problem, "exc", None)
            if isinstance(cause, MemoryError):
                raise cause from problem
            reason = cause if isinstance(cause, UrdfError) else problem
            raise UrdfError(
                f"{path} cannot be expanded: {_one_line(reason)}{values.advice(reason)}"
            ) from problem
        except Exception as problem:  # expressions of the file raise exceptions of any type
            kind = type(problem).__name__
            raise UrdfError(
                f"{path} cannot be expanded: {kind}: {_one_line(problem)}{values.advice(problem)}"
            ) from problem
    values.require_used(path)
    if len(text) > max_bytes:
        raise UrdfError(f"{path} expands to {len(text)} bytes; expected at most {max_bytes}")
    return bytes(text)


class _Arguments(dict[str, str]):
    """Values of ``<xacro:arg>``, which records the names that the expansion declares or reads.

    xacro ignores an argument that no file declares, so that a misspelt one would select the robot
    of its default value.
    """

    def __init__(self, given: dict[str, str]) -> None:
        super().__init__(given)
        self._given = tuple(given)
        self._used: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self._used.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self._used.add(name)
        return super().__getitem__(name)

    def advice(self, problem: BaseException) -> str:
        """Advice on a failed expansion: a missing argument, or one that may be misspelt."""
        missing = _UNDEFINED.search(str(problem))
        if missing is not None:
            return f"; expected it in xacro_args, as {missing.group(1)}: VALUE"
        for name in self._given:
            suggestion = "" if name in self._used else did_you_mean(name, sorted(self._used))
            if suggestion:
                return f"; the xacro argument {name!r} was not read{suggestion}"
        return ""

    def require_used(self, path: Path) -> None:
        """Raise `UrdfError` for given arguments that the file neither declares nor reads."""
        unknown = [name for name in self._given if name not in self._used]
        if unknown:
            known = sorted(self._used)
            raise UrdfError(
                f"{path} has no xacro argument {', '.join(map(repr, unknown))}; expected "
                f"{', '.join(known) or 'none'}{did_you_mean(unknown[0], known)}"
            )


class _Reader:
    """Opens files for an expansion, if they are in an allowed folder."""

    def __init__(self, path: Path, locator: MeshLocator) -> None:
        folder = path.resolve().parent
        above = (each for each in (folder, *folder.parents) if is_file(each / "package.xml"))
        self._folders = [next(above, folder)]
        self._locator = locator

    def open(self, name: str) -> BytesIO:
        path = Path(name)
        try:
            real = path.resolve()
        except (OSError, RuntimeError, ValueError) as problem:
            raise UrdfError(f"xacro file {name!r} cannot be read: {problem}") from problem
        if not any(real.is_relative_to(folder) for folder in self._folders):
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
        folder = self._locator.package_folder(package)
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


def _one_line(problem: BaseException) -> str:
    return " ".join(_PYTHON_CLASS.sub("", str(problem)).split())


if __name__ == "__main__":
    answer_request(lambda request: [answer(request.read())])
