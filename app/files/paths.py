"""Places of files: those that a document names, and the folder of the user's state."""

import hashlib
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath

from app.files.bounded_io import is_file, is_folder, open_for_reading
from app.files.packages import (
    OWN_PACKAGE,
    PACKAGE_SCHEME,
    PROJECT_DATA,
    PackageFolders,
    split_package_name,
)
from app.geometry import InputError

_DRIVE = re.compile(r"[A-Za-z]:")


MAX_PATH_CHARS = 4096
"""``PATH_MAX`` of Linux."""


def resolve_inside(folder: Path, name: str, where: str) -> Path:
    """Resolve ``name`` to an existing file or folder inside ``folder``.

    Raises `InputError`, with the place ``where``, for an absolute name, one with ``..`` or a
    backslash, one that leaves ``folder`` through a symbolic link, and one that does not exist.
    """
    _check_length(name, where)
    parts = PurePosixPath(name).parts
    if (
        not parts
        or name.startswith(("/", "~"))
        or ".." in parts
        or "\\" in name
        or "\0" in name
        or _DRIVE.match(name)
    ):
        raise InputError(f"{where} is {name!r}; expected a relative path without '..'")
    root = folder.resolve()
    try:
        path = (root / name).resolve()
    except (OSError, RuntimeError) as error:  # a loop of symbolic links, or a name too long
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{where} is {name!r}: the links cannot be followed ({reason})") from error
    if not path.is_relative_to(root):
        raise InputError(f"{where} is {name!r}: it leaves the folder {folder} by a symbolic link")
    if not (is_file(path) or is_folder(path)):
        problem = "not a file or folder" if os.path.lexists(path) else f"no such file in {folder}"
        raise InputError(f"{where} is {name!r}: {problem}")
    return path


def resolve_file(
    folder: Path, name: str, where: str, *, package_dirs: Sequence[str | Path] = ()
) -> Path:
    """Resolve ``name`` to an existing file: absolute, in ``folder`` or ``package://NAME/...``.

    A package is looked for in ``package_dirs``, and ``marginguard`` is the project's ``data/``: the
    first folder of `PackageFolders`. Raises `InputError` as `resolve_inside` does for a relative
    name, also for an unknown package.
    """
    _check_length(name, where)
    if Path(name).is_absolute():
        path = Path(name)
    elif not name.startswith(PACKAGE_SCHEME):
        path = resolve_inside(folder, name, where)
    else:
        package, rest = split_package_name(name)
        root = next(PackageFolders(package_dirs).named(package), None)
        if root is None:
            searched = ", ".join(str(path) for path in package_dirs) or "no --package-dir"
            raise InputError(f"{where} is {name!r}: package {package!r} not found ({searched})")
        path = resolve_inside(root, rest, where)
    if not is_file(path):
        raise InputError(f"{where} is {name!r}: {path} is not a file")
    return path


def resolve_package_folder(folder: Path, name: str, where: str) -> Path:
    """Resolve ``name``, absolute or relative to ``folder``, to an existing folder.

    Raises `InputError` as `resolve_inside` does.
    """
    _check_length(name, where)
    path = Path(name) if Path(name).is_absolute() else resolve_inside(folder, name, where)
    if not is_folder(path):
        raise InputError(f"{where} is {name!r}; expected an existing folder")
    return path.resolve()


def input_path(text: str) -> Path:
    """Path of an input that a user names: any path, or ``package://marginguard/REST``.

    The latter names shipped data, such as ``recorded_case``, wherever MarginGuard is installed.
    Raises `InputError` for another package and if REST does not exist. A path is not checked.
    """
    if not text.startswith(PACKAGE_SCHEME):
        return Path(text)
    package, rest = split_package_name(text)
    if package != OWN_PACKAGE:
        raise InputError(f"{text}: unknown package; expected {PACKAGE_SCHEME}{OWN_PACKAGE}/...")
    return resolve_inside(PROJECT_DATA, rest, text) if rest else PROJECT_DATA


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file as 64 hexadecimal digits; raise `InputError` if unreadable."""
    with open_for_reading(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _check_length(name: str, where: str) -> None:
    """Refuse a name that no system opens: resolving its parts would take seconds."""
    if len(name) > MAX_PATH_CHARS:
        raise InputError(f"{where} has {len(name)} characters; expected {MAX_PATH_CHARS} at most")


STATE_HOME = "XDG_STATE_HOME"


def state_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """``$XDG_STATE_HOME/marginguard``, by default ``~/.local/state/marginguard``; may not exist.

    As the XDG Base Directory Specification demands, a relative XDG_STATE_HOME is ignored. Raises
    `InputError` for a user without a home folder.
    """
    given = environment.get(STATE_HOME, "")
    if Path(given).is_absolute():
        return Path(given) / "marginguard"
    try:
        return Path.home() / ".local" / "state" / "marginguard"
    except RuntimeError as error:
        raise InputError(f"{STATE_HOME}: {error}; expected the path of a folder") from error
