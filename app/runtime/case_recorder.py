"""Record a live session as a case, by the command ``marginguard record`` in another process.

The recorder shares neither the interpreter nor the processor's time of the session's threads, and
it finishes its files when this process dies.
"""

import json
import os
import re
import subprocess
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import IO, Any

from app.case import SessionValues, sent_values
from app.files.child_process import module_command, reported_error, same_code
from app.geometry import InputError

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
NAME_EXPECTED = "at most 64 letters, digits, '_', '-' and '.', the first a letter or a digit"

_START_S, _STOP_S = 60.0, 60.0
_MAX_NAME = 40


@dataclass(frozen=True, slots=True)
class RecordingStatus:
    """State of a recording: its folder, its time, its messages.

    ``lost``: by topic, messages that are missing between those received from the same publisher.
    ``waiting``: topics without a publisher. ``problem``: why it has ended or what is missing, empty
    without one. ``active``: it is being written.
    """

    folder: Path
    active: bool
    duration_s: float = 0.0
    messages: int = 0
    lost: Mapping[str, int] = field(default_factory=dict)
    waiting: tuple[str, ...] = ()
    problem: str = ""

    @property
    def line(self) -> str:
        """One line for logs and displays."""
        state = "recording to" if self.active else "recorded in"
        text = (
            f"{state} {self.folder}: {self.duration_s:.0f} s, {self.messages} messages, "
            f"{self.lost_text}"
        )
        return f"{text}; {self.problem}" if self.problem else text

    @property
    def lost_text(self) -> str:
        """The number of lost messages, in total and by topic."""
        topics = ", ".join(f"{name} {count}" for name, count in self.lost.items())
        return f"{sum(self.lost.values())} lost{f' ({topics})' if topics else ''}"


class CaseRecorder:
    """Starts and stops recordings of the session of ``config``, one at a time. Thread-safe.

    Each is a case in a new folder below ``cases``, as ``marginguard record --config`` writes it.
    ``title`` and ``now()`` name a recording that has no name. ``ended(line)`` is called, in a
    thread of its own, for a recording that ends by itself, as on a full disk.
    """

    def __init__(
        self,
        config: Path,
        cases: Path,
        *,
        title: str,
        package_dirs: Sequence[Path] = (),
        namespace: str = "",
        now: Callable[[], datetime] = datetime.now,
        ended: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._config, self._cases, self._title = config.absolute(), cases.absolute(), title
        self._options = [
            *(f"--package-dir={folder}" for folder in package_dirs),
            *([f"--namespace={namespace}"] if namespace else []),
        ]
        self._now = now
        self.ended = ended
        self.depth: Callable[[], tuple[float, int] | None] = lambda: None
        """The imaging depth in mm that was chosen last; the stamp in ns after which it holds."""
        self._lock = threading.Lock()
        self._running: _Recording | None = None

    @property
    def status(self) -> RecordingStatus | None:
        """State of the last recording; None before the first."""
        running = self._running
        return None if running is None else running.status

    def start(self, name: str = "", values: SessionValues | None = None) -> Path:
        """Begin to record; return the new folder once messages are recorded. Takes seconds.

        ``values`` are those that the session uses at present; None for those of ``config``. Raises
        `InputError` for an invalid name, a folder that exists, while a recording runs, and where
        nothing can be written: then nothing is left.
        """
        with self._lock:
            if self._running is not None and self._running.status.active:
                raise InputError(
                    f"recording: one is running, in {self._running.status.folder}; expected none: "
                    "stop it first"
                )
            if name and not NAME.fullmatch(name):
                raise InputError(f"name of a recording: {name[:80]!r}; expected {NAME_EXPECTED}")
            folder = self._cases / (name or self._default_name())
            if os.path.lexists(folder):
                raise InputError(f"{folder} already exists; refusing to overwrite it")
            try:
                self._cases.mkdir(mode=0o700, parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(
                    f"{self._cases} cannot be written: {error.strerror}; expected a folder for "
                    "recordings"
                ) from error
            arguments = ["-o", str(folder), "--config", str(self._config), *self._options]
            if values is not None:
                arguments.append("--session-values")
            recording = _Recording(
                [*_command(), *arguments], folder, lambda line: self.ended(line), values
            )
            self._running = recording
            return recording.folder

    def note_replaced(self, parts: Sequence[str]) -> None:
        """Note in a running recording that ``parts`` of the session are not those of its case.

        Does not wait for a recording that begins.
        """
        running = self._running
        if parts and running is not None and running.status.active:
            running.note({"replaced": list(parts)})

    def note_depth(self) -> None:
        """Write the depth that was chosen last to a running recording."""
        running, chosen = self._running, self.depth()
        if chosen is not None and running is not None and running.status.active:
            running.note({"image_depth": chosen})

    def stop(self) -> RecordingStatus:
        """Finish the running recording and return its last status.

        Raises `InputError` if none is running, or if it did not end in order.
        """
        with self._lock:
            running = self._running
            if running is None or not running.status.active:
                raise InputError("recording: none is running; expected one: start it first")
            return running.stop()

    def close(self) -> None:
        """Finish a running recording."""
        with self._lock:
            if self._running is not None and self._running.status.active:
                self._running.stop()

    def _default_name(self) -> str:
        title = re.sub(r"[^A-Za-z0-9]+", "_", self._title).strip("_")[:_MAX_NAME] or "case"
        return f"{title}-{self._now():%Y%m%d-%H%M%S}"


class _Recording:
    """One run of the recorder. Raises `InputError` if it ends before it records."""

    def __init__(
        self,
        arguments: Sequence[str],
        folder: Path,
        ended: Callable[[str], None],
        values: SessionValues | None,
    ) -> None:
        self.folder = folder
        self.status = RecordingStatus(folder, active=False)
        self._ended = ended
        self._error = ""
        self._has_begun = self._stopping = False
        self._writing = threading.Lock()
        self._began, self._done = threading.Event(), threading.Event()
        self._process = subprocess.Popen(
            arguments,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=same_code(),
            start_new_session=True,  # Ctrl-C ends the session, which then ends the recording
        )
        errors = threading.Thread(target=self._read_errors, name="recorder errors", daemon=True)
        errors.start()
        threading.Thread(
            target=self._read_status, args=(errors,), name="recorder", daemon=True
        ).start()
        if values is not None:
            self._write(*sent_values(values))
        if not self._began.wait(_START_S):
            self._process.kill()
            self._done.wait(_STOP_S)
            raise InputError(
                f"recording: nothing was recorded after {_START_S:g} s; expected a recorder that "
                f"starts: {folder} may be incomplete"
            )
        if not self._has_begun:
            raise InputError(f"recording: {self._error}")

    def note(self, values: Mapping[str, Any]) -> None:
        """Send a line to the recorder: the names of replaced parts, or a depth."""
        self._write(json.dumps(values).encode() + b"\n")

    def stop(self) -> RecordingStatus:
        """Let the recorder finish its files, and wait for it."""
        self._stopping = True
        stdin = self._process.stdin
        if stdin is not None:
            stdin.close()
        if not self._done.wait(_STOP_S):
            self._process.kill()
            self._done.wait(_STOP_S)
        if self._error:
            raise InputError(f"recording: {self._error}; expected a complete one")
        return self.status

    def _write(self, *parts: bytes) -> None:
        """Write to the recorder, unless it has ended: its status says why."""
        stdin = self._process.stdin
        if stdin is None:
            return
        with self._writing, suppress(OSError, ValueError):
            for part in parts:
                stdin.write(part)
            stdin.flush()

    def _read_status(self, errors: threading.Thread) -> None:
        for line in _lines(self._process.stdout):
            values = _object(line).get("status")
            if isinstance(values, dict):
                self.status = RecordingStatus(
                    self.folder,
                    True,
                    float(values["duration_s"]),
                    int(values["messages"]),
                    {str(name): int(n) for name, n in values["lost"].items()},
                    tuple(values["waiting"]),
                    str(values["problem"]),
                )
                self._has_begun = True
                self._began.set()
        errors.join()
        code = self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            if stream is not None:
                stream.close()
        if code != 0 and not self._error:
            self._error = f"the recorder ended with status {code}"
        self.status = replace(self.status, active=False, problem=self._error)
        self._done.set()
        self._began.set()
        if self._has_begun and not self._stopping:
            self._ended(self.status.line)

    def _read_errors(self) -> None:
        for line in _lines(self._process.stderr):
            self._error = reported_error(line) or self._error


def _command() -> list[str]:
    return module_command("app.cli", "record", "--json", "--until-eof")


def _lines(stream: IO[bytes] | None) -> Sequence[bytes] | IO[bytes]:
    return () if stream is None else stream


def _object(line: bytes) -> dict[str, Any]:
    """The JSON object of a line; empty for other lines, such as those of ROS's log."""
    try:
        value = json.loads(line)
    except ValueError:
        return {}
    return value if isinstance(value, dict) else {}
