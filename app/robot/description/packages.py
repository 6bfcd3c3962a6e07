"""Where the meshes of a robot are: ``package://``, ``file://`` and relative names.

``package://NAME/REST`` is looked for in this order, and the first file that exists is taken:

1. each entry of ``package_dirs``: ``NAME=FOLDER``, a folder that is the package (it is called NAME
   or its ``package.xml`` says so), or a folder that holds the package;
2. the folders above the URDF, the nearest first: one that is the package, or holds it;
3. ``marginguard`` is the project's own ``data`` folder;
4. ``share/NAME`` under each entry of ``AMENT_PREFIX_PATH``, then ``ROS_PACKAGE_PATH``.

Only when none of these carries the name, the folders of 1 and 2 are tried as packages whatever
they are called: a checkout is often named otherwise than the package in it.

A description that came over the network has no file beside it and may not choose what is read: its
locator is *closed*, and finds only what lies, links followed, in a folder of 1, 3 or 4 or in one of
``allowed_dirs``; a name that is relative is looked for in those of 1 and in ``allowed_dirs``.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

from app.files.xml_guard import parse_xml, read_xml
from app.robot.errors import RobotMeshError, UrdfError

PROJECT_DATA = Path(__file__).resolve().parents[3] / "data"


class MeshLocator:
    """Finds the files that the description at ``urdf`` names; None makes it a closed one.

    ``allowed_dirs`` are further folders that a closed one may read from. ``environment`` stands in
    for the process's environment variables.
    """

    def __init__(
        self,
        urdf: Path | None,
        package_dirs: Sequence[str | Path] = (),
        environment: Mapping[str, str] | None = None,
        *,
        allowed_dirs: Sequence[str | Path] = (),
    ) -> None:
        self._above: tuple[Path, ...] = ()
        if urdf is not None:
            folder = urdf.resolve().parent
            self._above = (folder, *folder.parents)
        self._is_closed = urdf is None
        self._allowed = [Path(entry).resolve() for entry in allowed_dirs]
        self._named: list[tuple[str, Path]] = []
        self._given: list[tuple[str | None, Path]] = []
        self._environment = os.environ if environment is None else environment
        for entry in package_dirs:
            name, folder = split_entry(entry)
            if not folder.is_dir():
                raise UrdfError(f"package folder {str(entry)!r} is not a folder")
            self._given.append((name, folder.resolve()))
        self._allowed.extend(folder for _, folder in self._given)

    def package_folder(self, package: str) -> Path | None:
        """The first folder that is called ``package``, None when there is none."""
        return next(iter(self._folders_called(package)), None)

    def find(self, name: str) -> Path | None:
        """The file that ``name`` means, or None when there is none.

        Raises `RobotMeshError` for a name that is empty, of a scheme other than ``package`` and
        ``file``, that leaves its package by ``..``, or that is outside the allowed folders.
        """
        found = self._find(name)
        if found is not None and self._is_closed and not self._is_allowed(found):
            raise RobotMeshError(
                f"mesh {name!r} is outside the allowed mesh folders: "
                f"{', '.join(map(str, self._allowed)) or 'none is given'}"
            )
        return found

    def _is_allowed(self, file: Path) -> bool:
        real = file.resolve()
        folders = (*self._allowed, PROJECT_DATA, *self._installed())
        return any(real.is_relative_to(folder.resolve()) for folder in folders)

    def _installed(self) -> Iterator[Path]:
        yield from (prefix / "share" for prefix in self._path_variable("AMENT_PREFIX_PATH"))
        yield from self._path_variable("ROS_PACKAGE_PATH")

    def _find(self, name: str) -> Path | None:
        if not name.strip():
            raise RobotMeshError("a mesh has an empty file name")
        if "://" not in name:
            folders = self._allowed if self._is_closed else self._above[:1]
            if Path(name).is_absolute():
                return _existing(Path(name))
            return next((file for each in folders if (file := _existing(each / name))), None)
        parts = urlsplit(name)
        if parts.scheme == "file":
            if parts.netloc not in ("", "localhost"):
                raise RobotMeshError(f"mesh {name!r} is on another machine: local files only")
            return _existing(Path(unquote(parts.path)))
        if parts.scheme != "package":
            raise RobotMeshError(
                f"mesh {name!r} has the scheme {parts.scheme!r}: package, file or none wanted"
            )
        package, _, rest = name.removeprefix(f"{parts.scheme}://").partition("/")
        if package in ("", ".", ".."):
            raise RobotMeshError(f"mesh {name!r} names no package")
        return self._find_in_package(package, _inside(name, rest))

    def _find_in_package(self, package: str, rest: PurePosixPath) -> Path | None:
        known = False
        for folder in self._folders_called(package):
            known = True
            found = _existing(folder / rest)
            if found:
                return found
        if known:
            return None
        anonymous = [folder for name, folder in self._given if name is None]
        for folder in (*anonymous, *self._above):
            found = _existing(folder / rest)
            if found:
                return found
        return None

    def _folders_called(self, package: str) -> Iterator[Path]:
        for name, folder in self._given:
            if name == package:
                yield folder
            elif name is None:
                yield from _as_or_in(folder, package)
        for folder in self._above:
            yield from _as_or_in(folder, package)
        if package == "marginguard":
            yield PROJECT_DATA
        for prefix in self._path_variable("AMENT_PREFIX_PATH"):
            if (prefix / "share" / package).is_dir():
                yield prefix / "share" / package
        for folder in self._path_variable("ROS_PACKAGE_PATH"):
            yield from _as_or_in(folder, package)

    def _path_variable(self, name: str) -> Iterator[Path]:
        return (Path(part) for part in self._environment.get(name, "").split(os.pathsep) if part)


def split_entry(entry: str | Path) -> tuple[str | None, Path]:
    """``NAME=FOLDER`` to both; a folder whose own name has a ``=`` in it stays whole."""
    text = os.fspath(entry)
    name, sign, folder = text.partition("=")
    if sign and "/" not in name and not Path(text).is_dir():
        return name, Path(folder)
    return None, Path(text)


def _as_or_in(folder: Path, package: str) -> Iterator[Path]:
    """``folder`` itself where it is the package, and its subfolder that is."""
    if folder.name == package or _declared_name(folder) == package:
        yield folder
    if (folder / package).is_dir():
        yield folder / package


def _declared_name(folder: Path) -> str | None:
    manifest = folder / "package.xml"
    if not manifest.is_file():
        return None
    try:
        root = parse_xml(read_xml(manifest, UrdfError), manifest, UrdfError)
    except UrdfError:  # it may be of a stranger far above the URDF: such a folder has no name
        return None
    return (root.findtext("name") or "").strip() or None


def _inside(name: str, rest: str) -> PurePosixPath:
    depth = 0
    path = PurePosixPath(unquote(rest))
    for part in path.parts:
        depth += -1 if part == ".." else 1
        if depth < 0 or part == "/":
            raise RobotMeshError(f"mesh {name!r} leaves its package: no '..' beyond it allowed")
    return path


def _existing(path: Path) -> Path | None:
    try:
        return path if path.is_file() else None
    except (OSError, ValueError):  # a name too long, or with a null character
        return None
