"""Where the cases of a cohort come from: a manifest, a folder, a list or a URL; and their hashes.

URLs are read with fsspec, which has file systems for S3, HTTP and others behind one interface.
"""

import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

from app.cohort.cases import CohortCase
from app.cohort.manifest import MANIFEST_FILE, Cohort, open_manifest
from app.files.bounded_io import read_bounded
from app.files.paths import sha256_of
from app.geometry import InputError

CASE_FILE = "case.yaml"
MAX_LIST_BYTES = 200_000_000


def open_cohort(source: str) -> Cohort:
    """The cohort at ``source``.

    A folder with ``cohort.yaml`` or such a file: its manifest. Another folder or a URL: every
    folder below with a ``case.yaml``; where they are two levels deep, the first level is the group.
    Another file: a list of paths and URLs, one a line, empty lines and ``#`` comments left out.
    Raises `InputError`, also for no case and for two cases with one name.
    """
    if is_url(source):
        cohort = Cohort(source, recorded=tuple(_below_url(source)))
    else:
        path = Path(source)
        if path.suffix in (".yaml", ".yml") or (path / MANIFEST_FILE).is_file():
            return open_manifest(path)
        if path.is_dir():
            cohort = Cohort(path.absolute().name, recorded=tuple(_below(path.absolute())))
        else:
            cohort = Cohort(path.name, recorded=tuple(_listed(path)))
    if not len(cohort):
        raise InputError(f"{source} has no case; expected folders with a {CASE_FILE}")
    return cohort


def is_url(source: str) -> bool:
    """True for a URL."""
    return "://" in source


def input_hash(case: CohortCase) -> str:
    """SHA-256 of what determines the results of ``case``, in hexadecimal.

    A local folder: names and contents of its files. A URL: names and what its file system states of
    each file (size, ETag or time of modification). A simulated case: its seed and options. With
    ``tip_only`` it is another one. Raises `InputError` where there is no such folder.
    """
    digest = hashlib.sha256(b"tip_only\0" if case.tip_only else b"")
    if case.synthetic is not None:
        digest.update(json.dumps(asdict(case.synthetic)).encode())
    elif is_url(case.source):
        system, root = filesystem(case.source)
        for path in url_files(case.source):
            digest.update(f"{PurePosixPath(path).relative_to(root)}\0".encode())
            digest.update(f"{system.ukey(path)}\n".encode())
    else:
        for file in _files(Path(case.source)):
            digest.update(f"{file.relative_to(case.source)}\0{sha256_of(file)}\n".encode())
    return digest.hexdigest()


def filesystem(url: str) -> "tuple[Any, str]":
    """The file system of ``url`` and the path in it; raises `InputError` where it has none."""
    import fsspec

    try:
        system, root = fsspec.core.url_to_fs(url)
    except (ValueError, ImportError, OSError) as error:
        raise InputError(f"{url} cannot be opened: {error}") from error
    return system, root.rstrip("/")


def url_files(url: str) -> list[str]:
    """Paths of all files below ``url`` in its file system, sorted."""
    system, root = filesystem(url)
    try:
        found = sorted(system.find(root))
        if not found:
            system.ls(root)  # raises the error that `find` hides: a server that does not answer
    except Exception as error:  # every file system has errors of its own
        raise InputError(f"{url} cannot be listed: {error}") from error
    outside = [path for path in found if not _is_below(path, root)]
    if outside or not found:
        raise InputError(f"{url} has {outside[:1] or 'no files'}; expected files below it")
    return found


def _is_below(path: str, root: str) -> bool:
    if not path.startswith(f"{root}/"):
        return False
    relative = PurePosixPath(_relative(path, root))
    return not relative.is_absolute() and ".." not in relative.parts and "\0" not in str(relative)


def _relative(path: str, root: str) -> str:
    """``path`` below ``root``; the parts of an address of HTTP are percent-encoded."""
    relative = PurePosixPath(path).relative_to(root).as_posix()
    return unquote(relative) if root.startswith(("http://", "https://")) else relative


def fetch(url: str, folder: Path) -> None:
    """Copy all files below ``url`` to ``folder``; raises `InputError` or `OSError`."""
    system, root = filesystem(url)
    for path in url_files(url):
        target = folder / _relative(path, root)
        target.parent.mkdir(parents=True, exist_ok=True)
        system.get_file(path, str(target))


def _files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected a case folder")
    found = [Path(parent) / name for parent, _, names in os.walk(folder) for name in names]
    return sorted(path for path in found if path.is_file())


def _below(folder: Path) -> Iterator[CohortCase]:
    found = []
    for parent, folders, names in os.walk(folder):
        folders.sort()
        if CASE_FILE in names:
            folders.clear()
            found.append(Path(parent))
    for path in sorted(found):
        yield _named(path.relative_to(folder).as_posix(), str(path), folder.name)


def _below_url(url: str) -> Iterator[CohortCase]:
    _, root = filesystem(url)
    for path in url_files(url):
        place = PurePosixPath(path)
        if place.name == CASE_FILE:
            relative = place.parent.relative_to(root).as_posix()
            source = f"{url.rstrip('/')}/{relative}"
            yield _named(_relative(str(place.parent), root), source, PurePosixPath(root).name)


def _named(relative: str, source: str, folder: str) -> CohortCase:
    group, inner, _ = relative.partition("/")
    name = folder if relative == "." else relative
    return CohortCase(name, source, group=group if inner else "")


def _listed(path: Path) -> Iterator[CohortCase]:
    try:
        text = read_bounded(path, MAX_LIST_BYTES, InputError).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text; expected one case a line") from error
    for line in text.splitlines():
        source = line.strip()
        if source and not source.startswith("#"):
            place = source if is_url(source) else str(path.absolute().parent / source)
            yield CohortCase(PurePosixPath(source).name, place)
