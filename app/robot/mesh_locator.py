"""Resolves the mesh names of a description: ``package://``, ``file://``, absolute and relative.

The first file that exists in the folders of the package (see `app.files.paths`) is taken. Only
when no folder has the package's name, the folders of ``package_dirs`` and those above the URDF are
tried as the package: the folder of a checkout often has another name than its package.

A description from the network may not choose which files are read. Its locator is *closed*: it
finds only files that lie, with links followed, in ``package_dirs``, ``allowed_dirs``, installed ROS
packages and the project's data. A relative name is looked for in the first two.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

from app.files.bounded_io import is_file, is_folder
from app.files.mesh_file import FileMesh, MeshOptions, read_mesh_file
from app.files.paths import PROJECT_DATA, PackageFolders, split_package_name
from app.robot.elements import RobotMeshError, UrdfError


class MeshLocator:
    """Finds the files that the description at ``urdf`` names; closed when ``urdf`` is None.

    ``allowed_dirs`` are further folders that a closed locator may read from. ``environment``
    replaces the process's environment variables. Raises `UrdfError` for an entry of
    ``package_dirs`` that is not a folder.
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
        self._packages = PackageFolders(
            package_dirs,
            above=self._above,
            environment=os.environ if environment is None else environment,
        )
        for entry, (_, folder) in zip(package_dirs, self._packages.given, strict=True):
            if not is_folder(folder):
                raise UrdfError(f"package folder {str(entry)!r} is not a folder")
        self._allowed.extend(folder for _, folder in self._packages.given)

    def package_folder(self, package: str) -> Path | None:
        """Return the first folder of ``package``, None when there is none."""
        return next(self._packages.named(package), None)

    def find(self, name: str) -> Path | None:
        """Return the file that ``name`` means, or None when there is none.

        Raises `RobotMeshError` for an empty name, a scheme other than ``package`` and ``file``, a
        name that leaves its package by ``..``, and a file outside the allowed folders.
        """
        found = self._find(name)
        if found is not None and self._is_closed and not self._is_allowed(found):
            raise RobotMeshError(
                f"mesh {name!r} is outside the allowed mesh folders; expected one of "
                f"{', '.join(map(str, self._allowed)) or 'none'}"
            )
        return found

    def _is_allowed(self, file: Path) -> bool:
        real = file.resolve()
        folders = (*self._allowed, PROJECT_DATA, *self._packages.installed())
        return any(real.is_relative_to(folder.resolve()) for folder in folders)

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
                raise RobotMeshError(f"mesh {name!r} is on another machine; expected a local file")
            return _existing(Path(unquote(parts.path)))
        if parts.scheme != "package":
            raise RobotMeshError(
                f"mesh {name!r} has the scheme {parts.scheme!r}; expected package, file or none"
            )
        package, rest = split_package_name(name)
        if package in ("", ".", ".."):
            raise RobotMeshError(f"mesh {name!r} has no package name")
        return self._find_in_package(package, _inside(name, rest))

    def _find_in_package(self, package: str, rest: PurePosixPath) -> Path | None:
        is_named = False
        for folder in self._packages.named(package):
            is_named = True
            if file := _existing(folder / rest):
                return file
        if is_named:
            return None
        unnamed = (folder for name, folder in self._packages.given if name is None)
        folders = (*unnamed, *self._above)
        return next((file for each in folders if (file := _existing(each / rest))), None)


def _inside(name: str, rest: str) -> PurePosixPath:
    depth = 0
    path = PurePosixPath(unquote(rest))
    for part in path.parts:
        depth += -1 if part == ".." else 1
        if depth < 0 or part == "/":
            raise RobotMeshError(f"mesh {name!r} leaves its package; expected a path inside it")
    return path


def _existing(path: Path) -> Path | None:
    return path if is_file(path) else None


OPTIONS = MeshOptions(
    formats=(".stl", ".obj", ".dae", ".glb", ".gltf", ".ply"),
    max_bytes=80 * 1024 * 1024,
    max_triangles=2_500_000,
    linked_files=True,
    error=RobotMeshError,
)


def read_robot_mesh(path: Path) -> FileMesh:
    """Read a mesh file of a robot, in the file's unit (m for COLLADA).

    Raises `RobotMeshError` as `read_mesh_file` describes.
    """
    return read_mesh_file(path, OPTIONS)
