"""The cases of a folder with their results, computed once for each content."""

import hashlib
import json
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from app.files.atomic_io import write_files
from app.files.bounded_io import read_bounded
from app.files.paths import sha256_of
from app.geometry import InputError, MarginGuardError

MANIFEST = "case.yaml"
MAX_CASES, MAX_FILES = 500, 5000
_MAX_SUMMARY_BYTES, _MAX_PICTURE_BYTES = 1 << 20, 4 << 20


@dataclass(frozen=True, slots=True)
class CaseResult:
    """Result of a case in the library: ``values`` of JSON types, and a small PNG, None without."""

    values: Mapping[str, Any]
    picture: bytes | None


Summarise = Callable[[Path], CaseResult]
"""Replays the case in a folder; takes seconds to minutes. Raises `InputError`."""


@dataclass(slots=True)
class _Entry:
    folder: Path
    changed_ns: int
    fingerprint: str
    result: CaseResult | None = None
    problem: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class CaseLibrary:
    """The cases in the folders directly below ``root``. Thread-safe.

    A thread computes the results, one case at a time, and keeps them in ``cache`` under the SHA-256
    of the files in the case's folder and ``version``. Files outside of it, such as those of
    packages, are not part of it. A case whose files have changed is computed anew.
    """

    root: Path
    cache: Path
    summarise: Summarise
    version: str
    _entries: dict[str, _Entry] = field(default_factory=dict)
    _wake: threading.Condition = field(default_factory=threading.Condition)
    _closing: threading.Event = field(default_factory=threading.Event)

    def start(self) -> None:
        """Read the folder, and compute in a thread what is missing. Raises `InputError`."""
        self.refresh()
        threading.Thread(target=self._work, name="case library", daemon=True).start()

    def close(self) -> None:
        """Compute nothing more."""
        self._closing.set()
        with self._wake:
            self._wake.notify_all()

    def refresh(self) -> None:
        """Read names, sizes and times of the files anew. Raises `InputError`."""
        found = {folder.name: _scanned(folder) for folder in _case_folders(self.root)}
        with self._wake:
            for name, entry in found.items():
                known = self._entries.get(name)
                if known is not None and known.fingerprint == entry.fingerprint:
                    found[name] = known
            self._entries.clear()
            self._entries.update(found)
            self._wake.notify_all()

    def rows(self) -> list[dict[str, object]]:
        """The cases as the page shows them, the newest first."""
        with self._wake:
            entries = list(self._entries.items())
        entries.sort(key=lambda item: (-item[1].changed_ns, item[0]))
        return [_row(name, entry) for name, entry in entries]

    def folder(self, name: str) -> Path:
        """Folder of the case ``name``. Raises `InputError` for another name."""
        with self._wake:
            entry = self._entries.get(name)
        if entry is None:
            raise InputError(f"case {name[:80]!r}: not in the library; expected one of its cases")
        return entry.folder

    def picture(self, name: str) -> bytes | None:
        """PNG of the case ``name``; None while there is none."""
        with self._wake:
            entry = self._entries.get(name)
            return None if entry is None or entry.result is None else entry.result.picture

    def checked(self, folder: Path) -> None:
        """Replay a case that is not in the library yet, and keep its result.

        Raises `InputError` for one that cannot be replayed.
        """
        digest = self._digest(folder)
        if self._cached(digest) is None:
            self._keep(digest, self.summarise(folder))

    def _work(self) -> None:
        while not self._closing.is_set():
            with self._wake:
                waiting = (
                    entry
                    for entry in sorted(self._entries.values(), key=lambda each: -each.changed_ns)
                    if entry.result is None and not entry.problem
                )
                entry = next(waiting, None)
                if entry is None:
                    self._wake.wait()
                    continue
            self._compute(entry)

    def _compute(self, entry: _Entry) -> None:
        result, problem = None, ""
        try:
            digest = self._digest(entry.folder)
            result = self._cached(digest)
            if result is None:
                result = self.summarise(entry.folder)
                self._keep(digest, result)
        except (MarginGuardError, OSError) as error:
            problem = " ".join(str(error).split()) or type(error).__name__
        with self._wake:
            entry.problem, entry.result = problem if result is None else "", result

    def _digest(self, folder: Path) -> str:
        """SHA-256 of the names and contents of the files in ``folder``."""
        total = hashlib.sha256(self.version.encode())
        for path in sorted(_files(folder)):
            total.update(f"\0{path.relative_to(folder)}\0{sha256_of(path)}".encode())
        return total.hexdigest()

    def _cached(self, digest: str) -> CaseResult | None:
        try:
            text = read_bounded(self.cache / f"{digest}.json", _MAX_SUMMARY_BYTES)
            values = json.loads(text)
        except (InputError, OSError, ValueError):
            return None
        if not isinstance(values, dict):
            return None
        try:
            picture = read_bounded(self.cache / f"{digest}.png", _MAX_PICTURE_BYTES)
        except (InputError, OSError):
            picture = None
        return CaseResult(values, picture)

    def _keep(self, digest: str, result: CaseResult) -> None:
        """Write to the cache; a result that cannot be kept is computed again next time."""
        contents = {f"{digest}.json": json.dumps(dict(result.values)).encode()}
        if result.picture is not None:
            contents[f"{digest}.png"] = result.picture
        try:
            self.cache.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_files(self.cache, contents)
        except OSError:
            return


def _case_folders(root: Path) -> list[Path]:
    try:
        with os.scandir(root) as entries:
            names = sorted(
                entry.name
                for entry in entries
                if not entry.name.startswith(".")
                and entry.name.isprintable()
                and entry.is_dir(follow_symlinks=False)
            )
    except OSError as error:
        raise InputError(f"{root}: {error.strerror}; expected a folder of cases") from error
    found = [root / name for name in names if (root / name / MANIFEST).is_file()]
    return found[:MAX_CASES]


def _files(folder: Path) -> Iterator[Path]:
    """The regular files in ``folder``, without those behind links. Raises `InputError`."""
    count = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            path = Path(parent, name)
            if path.is_symlink() or not path.is_file():
                continue
            count += 1
            if count > MAX_FILES:
                raise InputError(f"{folder}: more than {MAX_FILES} files; expected a case")
            yield path


def _scanned(folder: Path) -> _Entry:
    total, newest_ns, problem = hashlib.sha256(), 0, ""
    try:
        for path in sorted(_files(folder)):
            about = path.stat()
            newest_ns = max(newest_ns, about.st_mtime_ns)
            name = path.relative_to(folder)
            total.update(f"\0{name}\0{about.st_size}\0{about.st_mtime_ns}".encode())
    except (InputError, OSError) as error:
        problem = " ".join(str(error).split())
    return _Entry(folder, newest_ns, total.hexdigest(), problem=problem)


def _row(name: str, entry: _Entry) -> dict[str, object]:
    changed = datetime.fromtimestamp(entry.changed_ns / 1e9, UTC).isoformat(timespec="seconds")
    state = "failed" if entry.problem else "computing" if entry.result is None else "ready"
    values = {} if entry.result is None else dict(entry.result.values)
    picture = entry.result is not None and entry.result.picture is not None
    return {
        "folder": name,
        "changed": changed,
        "state": state,
        "problem": entry.problem,
        "picture": picture,
        **values,
    }
