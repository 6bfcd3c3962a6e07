"""The page of a folder of cases, with their results and replay pages in other processes."""

import argparse
import asyncio
import io
import json
import os
import signal
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from app import __version__
from app.cli.child_commands import child_of_command
from app.files.bounded_io import read_bounded
from app.files.child_process import reported_error
from app.geometry import InputError
from app.viewer.library_server import LibraryServer

if TYPE_CHECKING:
    from app.viewer import Role
    from app.viewer.case_library import CaseResult


_DEFAULT_UPLOAD_MB = 512
_TIMEOUT_S = 1800.0
_PICTURE_SIZE = (480, 300)
_MAX_PICTURE_BYTES = 64 << 20
_NICE = 10
_MAX_ERROR_BYTES = 1 << 16


@contextmanager
def library_page(options: argparse.Namespace) -> Iterator["LibraryServer"]:
    """The page of ``marginguard view FOLDER``."""
    from app.cli.caches import RESULTS_FOLDER
    from app.fixture.proximity.field_cache import cache_folder
    from app.viewer.case_library import CaseLibrary
    from app.viewer.library_server import LibraryServer

    replays = CaseReplays(options.package_dirs)
    page = OpenedPage(options.host, options.allow_host, options.package_dirs)
    library = CaseLibrary(
        options.case.absolute(), cache_folder() / RESULTS_FOLDER, replays.result, __version__
    )
    library.start()
    max_mb = _DEFAULT_UPLOAD_MB if options.max_upload_mb is None else options.max_upload_mb
    try:
        yield LibraryServer(library, page.open, max_mb << 20)
    finally:
        library.close()
        replays.close()
        page.close()


class CaseReplays:
    """Replays cases as ``marginguard replay --report`` does, with low priority, for a library."""

    def __init__(self, package_dirs: Sequence[Path]) -> None:
        self._options = [f"--package-dir={folder}" for folder in package_dirs]
        self._running: list[subprocess.Popen[bytes]] = []

    def result(self, folder: Path) -> "CaseResult":
        """Replay the case in ``folder``. Raises `InputError` with the reason if that fails."""
        from app.viewer.case_library import CaseResult

        with TemporaryDirectory() as report:
            command = ["replay", str(folder), "--no-ros", "--json", "--report", report]
            process = _started(
                "nice", "-n", str(_NICE), *child_of_command(*command, *self._options)
            )
            self._running.append(process)
            try:
                output, errors = process.communicate(timeout=_TIMEOUT_S)
            except subprocess.TimeoutExpired as error:
                raise InputError(
                    f"{folder.name}: not replayed within {_TIMEOUT_S:g} s; expected a shorter case"
                ) from error
            finally:
                _kill(process)
                self._running.remove(process)
            if process.returncode not in (0, 1):  # 1: other results than the case expects
                raise InputError(_reason(errors) or f"replay ended with {process.returncode}")
            values = case_values(json.loads(output))
            return CaseResult(values, _small_picture(Path(report, "scene.png")))

    def close(self) -> None:
        """End a running replay."""
        for process in list(self._running):
            _kill(process)


def case_values(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a ``summary.json`` that the library shows."""
    from app.report import all_passed

    depths = [
        depth
        for breach in summary["breaches"]
        for key in ("path_min_signed_distance_mm", "min_signed_distance_mm")
        if (depth := breach[key]) is not None
    ]
    registration = summary["registration"]
    return {
        "name": summary["case"],
        "kind": summary["provenance"].get("kind", ""),
        "duration_s": summary["duration_s"],
        "frames": summary["frames"],
        "valid_frames": summary["valid_frames"],
        "breaches": len(summary["breaches"]),
        "deepest_mm": min(depths, default=None),
        "min_signed_distance_mm": summary["min_signed_distance_mm"],
        "state_seconds": summary["state_seconds"],
        "stop_mm": summary["margins"]["stop_mm"],
        "warn_mm": summary["margins"]["warn_mm"],
        "registration": None if registration is None else registration["accepted"],
        "fre_mm": None if registration is None else registration["fre_mm"],
        "as_expected": None if summary["expected"] is None else all_passed(dict(summary)),
        "notes": len(summary["notes"]),
    }


class OpenedPage:
    """The replay page of one case at a time, as ``marginguard view`` serves it."""

    def __init__(self, host: str, names: Sequence[str], package_dirs: Sequence[Path]) -> None:
        self._options = [
            *(f"--host={host}", "--port=0"),
            *(f"--allow-host={name}" for name in names),
            *(f"--package-dir={folder}" for folder in package_dirs),
        ]
        self._process: subprocess.Popen[bytes] | None = None

    async def open(self, folder: Path) -> "dict[Role, str]":
        """End the page before it; serve that of the case in ``folder`` and return its URLs."""
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(None, self.close)
        # In this thread: a child of another one would end with that thread.
        command = child_of_command("--json", "view", str(folder), *self._options)
        process = self._process = _started(*command)
        return await loop.run_in_executor(None, _urls, process)

    def close(self) -> None:
        """End the page."""
        process, self._process = self._process, None
        if process is not None:
            _kill(process)


def _started(*command: str) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def _urls(process: "subprocess.Popen[bytes]") -> "dict[Role, str]":
    from app.viewer import Role

    if process.stdout is None or process.stderr is None:
        raise InputError("view: no output; expected its address")
    lines = [process.stdout.readline().decode().strip() for _ in range(2)]
    if not lines[1]:
        raise InputError(
            _reason(process.stderr.read(_MAX_ERROR_BYTES)) or "view: ended without an address"
        )
    return {Role.OPERATE: lines[0], Role.VIEW: lines[1].removeprefix("view only: ")}


def _kill(process: "subprocess.Popen[bytes]") -> None:
    """End the process and its children, and wait for it."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for stream in (process.stdout, process.stderr):
        if stream is not None:
            stream.close()


def _reason(errors: bytes) -> str:
    """The last error among the lines that a command has printed."""
    return next(filter(None, map(reported_error, reversed(errors.splitlines()))), "")


def _small_picture(path: Path) -> bytes | None:
    """The picture of the report as a small PNG; None where it was not drawn."""
    from PIL import Image

    try:
        data = read_bounded(path, _MAX_PICTURE_BYTES)
    except InputError:
        return None
    with Image.open(io.BytesIO(data)) as image:
        image.thumbnail(_PICTURE_SIZE)
        small = io.BytesIO()
        image.convert("RGB").save(small, "PNG", optimize=True)
    return small.getvalue()
