"""Folders of the packages that ``package://NAME/REST`` names.

The folders of a package, in this order:

1. each entry of ``package_dirs``: ``NAME=FOLDER``, a folder that is the package (it is called NAME
   or its ``package.xml`` names it), or a folder that contains the package, under its name or, up
   to two levels below, in a folder whose ``package.xml`` names it;
2. the folders ``above`` a file, the nearest first: one that is the package, or contains it;
3. for ``marginguard`` the project's own ``data`` folder;
4. ``share/NAME`` under each entry of ``AMENT_PREFIX_PATH``, then ``ROS_PACKAGE_PATH``.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

from app.files.bounded_io import is_file, is_folder
from app.files.shipped import shipped
from app.files.xml_guard import parse_xml, read_xml
from app.geometry import InputError

PACKAGE_SCHEME = "package://"
OWN_PACKAGE = "marginguard"
PROJECT_DATA = shipped("data")

_MAX_MANIFEST_BYTES = 1_000_000
_MAX_SEARCHED = 2000
"""Limit for the folders that are searched below one entry."""

_LEVELS = 2


class PackageFolders:
    """Finds the folders of packages.

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
