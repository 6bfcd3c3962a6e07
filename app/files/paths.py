"""Places of files: shipped ones, those that a document names, and the folder of the user's state.

MarginGuard ships data, Slicer modules, RViz, Foxglove and benchmarks beside its code. These folders
are below the project's root in a checkout and in an editable installation. A wheel holds them in
``app/share``, where ``tools/build_py.py`` copies them.
"""

import hashlib
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from itertools import islice
from pathlib import Path, PurePosixPath

from app.files.bounded_io import is_file, is_folder, open_for_reading
from app.files.xml_guard import parse_xml, read_xml
from app.geometry import InputError

_PACKAGE = Path(str(files("app")))
_SHARE = _PACKAGE / "share"


def checkout() -> Path | None:
    """Root of the checkout that contains this code; None if it was installed from a wheel.

    An editable installation (``pip install -e``) runs the code of its checkout.
    """
    return None if _SHARE.is_dir() else _PACKAGE.parent


def shipped(*parts: str) -> Path:
    """Path of a shipped file or folder: ``shipped("data", "recorded_case")``. May not exist."""
    return (checkout() or _SHARE).joinpath(*parts)


PACKAGE_SCHEME = "package://"
OWN_PACKAGE = "marginguard"
PROJECT_DATA = shipped("data")

_MAX_MANIFEST_BYTES = 1_000_000
_MAX_SEARCHED = 2000
"""Limit for the folders that are searched below one entry."""

_LEVELS = 2


class PackageFolders:
    """Finds the folders of packages that ``package://NAME/REST`` names.

    The folders of a package, in this order:

    1. each entry of ``package_dirs``: ``NAME=FOLDER``, a folder that is the package (it is called
       NAME or its ``package.xml`` names it), or a folder that contains the package, under its name
       or, up to two levels below, in a folder whose ``package.xml`` names it;
    2. the folders ``above`` a file, the nearest first: one that is the package, or contains it;
    3. for ``marginguard`` the project's own ``data`` folder;
    4. ``share/NAME`` under each entry of ``AMENT_PREFIX_PATH``, then ``ROS_PACKAGE_PATH``.

    ``given`` has the entries of ``package_dirs``: a name or None, and the folder with links
    followed. ``environment`` holds the two ROS path variables. Without it, installed ROS packages
    are not found.
    """

    def __init__(
        self,
        package_dirs: Sequence[str | Path] = (),
        *,
        above: Sequence[Path] = (),
        environment: Mapping[str, str] | None = None,
    ) -> None:
        pairs = map(split_package_dir, package_dirs)
        self.given = tuple((name, folder.resolve()) for name, folder in pairs)
        self._above = tuple(above)
        self._environment = environment or {}

    def named(self, package: str) -> Iterator[Path]:
        """Yield the folders of ``package``, the preferred one first."""
        if package in ("", ".", ".."):
            return
        for name, folder in self.given:
            if name == package:
                yield folder
            elif name is None:
                yield from _as_or_in(folder, package)
                yield from _declared_below(folder, package)
        for folder in self._above:
            yield from _as_or_in(folder, package)
        if package == OWN_PACKAGE:
            yield PROJECT_DATA
        for prefix in self._path_variable("AMENT_PREFIX_PATH"):
            if is_folder(prefix / "share" / package):
                yield prefix / "share" / package
        for folder in self._path_variable("ROS_PACKAGE_PATH"):
            yield from _as_or_in(folder, package)

    def installed(self) -> Iterator[Path]:
        """Yield the folders that contain the installed ROS packages."""
        yield from (prefix / "share" for prefix in self._path_variable("AMENT_PREFIX_PATH"))
        yield from self._path_variable("ROS_PACKAGE_PATH")

    def _path_variable(self, name: str) -> Iterator[Path]:
        return (Path(part) for part in self._environment.get(name, "").split(os.pathsep) if part)


def split_package_name(name: str) -> tuple[str, str]:
    """``package://NAME/REST`` to NAME and REST."""
    package, _, rest = name.removeprefix(PACKAGE_SCHEME).partition("/")
    return package, rest


def split_package_dir(entry: str | Path) -> tuple[str | None, Path]:
    """``NAME=FOLDER`` to both; a folder whose own name contains ``=`` is not split."""
    text = os.fspath(entry)
    name, sign, folder = text.partition("=")
    if sign and "/" not in name and not is_folder(Path(text)):
        return name, Path(folder)
    return None, Path(text)


def _as_or_in(folder: Path, package: str) -> Iterator[Path]:
    """``folder`` itself where it is the package, and its subfolder of that name."""
    if folder.name == package or _declared_name(folder) == package:
        yield folder
    if is_folder(folder / package):
        yield folder / package


def _declared_below(folder: Path, package: str) -> Iterator[Path]:
    """Folders below ``folder`` whose ``package.xml`` names ``package``, in alphabetical order."""
    level, searched = [folder], 0
    for _ in range(_LEVELS):
        below: list[Path] = []
        for each in level:
            below.extend(islice(_subfolders(each), max(0, _MAX_SEARCHED - searched - len(below))))
        searched += len(below)
        yield from (each for each in below if _declared_name(each) == package)
        level = below


def _subfolders(folder: Path) -> list[Path]:
    try:
        names = sorted(entry.name for entry in os.scandir(folder) if entry.is_dir())
    except OSError:
        return []
    return [folder / name for name in names if not name.startswith(".")]


def _declared_name(folder: Path) -> str | None:
    manifest = folder / "package.xml"
    if not is_file(manifest):
        return None
    try:
        root = parse_xml(
            read_xml(manifest, InputError, max_bytes=_MAX_MANIFEST_BYTES), manifest, InputError
        )
    except InputError:  # a broken manifest, for example of an unrelated folder far above a URDF
        return None
    return (root.findtext("name") or "").strip() or None


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
        raise InputError(f"{where} is {name!r}: {problem}; expected an existing file or folder")
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
