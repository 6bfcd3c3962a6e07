"""Names of files in a manifest: inside the case's folder, or inside a package's."""

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from app.geometry import InputError

PACKAGE_SCHEME = "package://"
OWN_PACKAGE = "marginguard"
_PROJECT_DATA = Path(__file__).resolve().parents[2] / "data"
_DRIVE = re.compile(r"[A-Za-z]:")


def resolve_inside(folder: Path, name: str, where: str) -> Path:
    """The existing file or folder ``name`` of ``folder``.

    Raises `InputError`, which names the place ``where``, for an absolute name, one with ``..`` or
    a backslash, one that leaves ``folder`` through a symbolic link, and for one that is not there.
    """
    parts = PurePosixPath(name).parts
    if (
        not parts
        or name.startswith(("/", "~"))
        or ".." in parts
        or "\\" in name
        or "\0" in name
        or _DRIVE.match(name)
    ):
        raise InputError(f"{where} is {name!r}: a relative path without '..' wanted")
    root = folder.resolve()
    try:
        path = (root / name).resolve()
    except (OSError, RuntimeError) as error:  # a loop of symbolic links
        raise InputError(f"{where} is {name!r}: it cannot be followed ({error})") from error
    if not path.is_relative_to(root):
        raise InputError(f"{where} is {name!r}: it leaves the folder {folder} by a symbolic link")
    if not path.exists():
        raise InputError(f"{where} is {name!r}: no such file in {folder}")
    return path


def resolve_file(folder: Path, name: str, where: str, *, package_dirs: Sequence[Path] = ()) -> Path:
    """The existing file ``name``: relative to ``folder``, or ``package://PACKAGE/...``.

    ``package://marginguard/`` is the project's ``data/``. Another package is a folder of that name
    that is in ``package_dirs``, or lies directly in one of them.
    """
    if not name.startswith(PACKAGE_SCHEME):
        path = resolve_inside(folder, name, where)
    else:
        package, _, rest = name.removeprefix(PACKAGE_SCHEME).partition("/")
        root = _package_folder(package, package_dirs)
        if root is None:
            searched = ", ".join(str(path) for path in package_dirs) or "no --package-dir"
            raise InputError(f"{where} is {name!r}: package {package!r} not found ({searched})")
        path = resolve_inside(root, rest, where)
    if not path.is_file():
        raise InputError(f"{where} is {name!r}: a file wanted, {path} is none")
    return path


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file, in 64 hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _package_folder(package: str, package_dirs: Sequence[Path]) -> Path | None:
    if package in ("", ".", ".."):
        return None
    for folder in package_dirs:
        if folder.resolve().name == package:
            return folder
        if (folder / package).is_dir():
            return folder / package
    return _PROJECT_DATA if package == OWN_PACKAGE else None
