"""Files that MarginGuard keeps on disk between runs: kernels, distance fields, parts, results.

Only files with the names that MarginGuard writes count, and only regular ones: symbolic links are
neither followed nor removed, and other files stay.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib.resources import files
from pathlib import Path
from typing import Any

KERNELS, FIELDS, PARTS = "compiled kernels", "distance fields", "convex parts"
RESULTS, RESULTS_FOLDER = "results of cases", "library"
_KERNEL_FILES = ("*.nbi", "*.nbc")
_FIELD_FILES = ("*.field", "*.part")
_PARTS_FILES = ("*.parts",)
_RESULT_FILES = ("*.json", "*.png")


@dataclass(frozen=True, slots=True)
class CacheFolder:
    """A folder with files of one kind. ``removable``: also the folder, once it is empty."""

    kind: str
    path: Path
    patterns: tuple[str, ...]
    removable: bool


@dataclass(frozen=True, slots=True)
class CacheContent:
    """Files that `inspect` or `remove` found in a folder; ``problem`` is empty if all went well."""

    folder: CacheFolder
    count: int
    size_bytes: int
    problem: str = ""


def cache_folders() -> list[CacheFolder]:
    """Every existing folder in which this installation keeps files, links to folders included.

    numba keeps compiled kernels beside their source files, in ``NUMBA_CACHE_DIR`` if that is set,
    and in the user's cache where the installation is read-only.
    """
    from app.fixture.proximity.field_cache import cache_folder
    from app.simulation.rigid_body import PARTS_FOLDER

    found = [
        *_kernel_folders(),
        CacheFolder(PARTS, cache_folder() / PARTS_FOLDER, _PARTS_FILES, True),
        CacheFolder(RESULTS, cache_folder() / RESULTS_FOLDER, _RESULT_FILES, True),
        CacheFolder(FIELDS, cache_folder(), _FIELD_FILES, True),
    ]
    return [folder for folder in found if os.path.lexists(folder.path)]


def _kernel_folders() -> Iterator[CacheFolder]:
    from numba import config
    from numba.core.caching import UserProvidedCacheLocator
    from numba.misc.appdirs import AppDirs

    settings: Any = config
    # numba's own rules: they name a folder below a common one by the path of the source file.
    locator: Any = UserProvidedCacheLocator
    subfolder = locator.get_suitable_cache_subpath
    common = {AppDirs(appname="numba", appauthor=False).user_cache_dir, settings.CACHE_DIR}
    package = Path(str(files("app")))
    sources = sorted({path.parent for path in package.rglob("*.py")})
    for source in sources:
        yield CacheFolder(KERNELS, source / "__pycache__", _KERNEL_FILES, False)
        for parent in sorted(filter(None, common)):
            path = Path(parent, subfolder(str(source / "x.py")))
            yield CacheFolder(KERNELS, path, _KERNEL_FILES, True)


def visit(folder: CacheFolder, *, removing: bool) -> CacheContent:
    """Count the files of ``folder``; ``removing`` them, and the folder if it is then empty."""
    count = size = 0
    problem = ""
    try:
        # Relative to the opened folder: a link that replaces the folder meanwhile has no effect.
        with _opened(folder.path) as descriptor:
            for entry in _matching(descriptor, folder.patterns):
                about = entry.stat(follow_symlinks=False)
                if removing:
                    os.unlink(entry.name, dir_fd=descriptor)
                count, size = count + 1, size + about.st_size
            empty = not any(os.scandir(descriptor))
        if removing and folder.removable and empty:
            folder.path.rmdir()
    except OSError as error:
        link = folder.path.is_symlink()
        problem = "a symbolic link, which is not followed" if link else error.strerror or str(error)
    return CacheContent(folder, count, size, problem)


@contextmanager
def _opened(folder: Path) -> Iterator[int]:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _matching(descriptor: int, patterns: tuple[str, ...]) -> list["os.DirEntry[str]"]:
    with os.scandir(descriptor) as entries:
        return [
            entry
            for entry in entries
            if entry.is_file(follow_symlinks=False)
            and any(fnmatchcase(entry.name, pattern) for pattern in patterns)
        ]
