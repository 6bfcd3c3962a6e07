"""State of a live session on disk while it runs: its locks, its hold and the values in use."""

import fcntl
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from app.files.atomic_io import write_durably
from app.geometry import MarginGuardError
from app.hold.changes import UsedValues, causes_of_change
from app.hold.record import (
    HoldRecord,
    InstanceKey,
    RunRecord,
    SecondInstanceError,
    Slot,
    StateFileError,
    as_bytes,
    causes_of_damage,
    causes_of_record,
    read_record,
)

_MAX_HOLDER_BYTES = 400
_RETRY_S = 0.2
"""A replay has a lock for some microseconds while it checks it (`check_no_guard`)."""

_EXPECTED = "expected one guard for each namespace and arm: end the other one first"

BEAT_S = 1.0
"""Interval at which a running guard says that it is alive."""

_CLOSE_S = 5.0


class InstanceLock:
    """The exclusive lock of ``slot`` at ``path``, held until `close`.

    The kernel keeps a lock (flock) as long as the process lives, and releases it at its end, also
    after SIGKILL. The file itself stays: if it were removed, a third process could lock a new one.

    Raises `SecondInstanceError` if another process has it, with the text ``holder`` that it wrote,
    and `StateFileError` if the file cannot be used. ``last_alive_ns`` is the system time at which
    the previous holder last called `touch`; None without one.
    """

    def __init__(self, path: Path, slot: Slot, holder: str) -> None:
        self._path = path
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        except OSError as error:
            raise _unusable(path, error) from error
        try:
            _lock(self._descriptor, fcntl.LOCK_EX, slot)
            about = os.fstat(self._descriptor)
            self.last_alive_ns = about.st_mtime_ns if about.st_size else None
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, holder.encode()[:_MAX_HOLDER_BYTES], 0)
        except OSError as error:
            self.close()
            raise _unusable(path, error) from error
        except SecondInstanceError:
            self.close()
            raise

    def touch(self) -> None:
        """Note that the holder is alive now."""
        os.utime(self._descriptor)

    @property
    def is_removed(self) -> bool:
        """True if the file was removed, so that it excludes no other process any more."""
        return os.fstat(self._descriptor).st_nlink == 0

    def close(self) -> None:
        """Release the lock."""
        os.close(self._descriptor)


def check_no_guard(path: Path, slot: Slot) -> None:
    """Raise `SecondInstanceError` if a guard has ``slot``; changes no file and keeps no lock.

    For replays, which publish the same topics as a guard.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:  # no guard has used this slot yet
        return
    try:
        _lock(descriptor, fcntl.LOCK_SH, slot)
    finally:
        os.close(descriptor)


def describe_holder(namespace: str, arm: str) -> str:
    """Text by which a refused process names this one."""
    began = time.strftime("%Y-%m-%dT%H:%M:%S%z")
    arm_text = f", arm {arm!r}" if arm else ""
    return f"process {os.getpid()} (namespace {namespace!r}{arm_text}, since {began})"


def _lock(descriptor: int, kind: int, slot: Slot) -> None:
    ends_s = time.monotonic() + _RETRY_S
    while True:
        try:
            fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
            return
        except BlockingIOError as error:
            if time.monotonic() >= ends_s:
                text = os.pread(descriptor, _MAX_HOLDER_BYTES, 0).decode(errors="replace")
                holder = "".join(each if each.isprintable() else " " for each in text).strip()
                raise SecondInstanceError(
                    f"{slot}: {holder or 'another process'} has it; {_EXPECTED}"
                ) from error
        time.sleep(_RETRY_S / 10)


def _unusable(path: Path, error: OSError) -> StateFileError:
    return StateFileError(
        f"{path} cannot be locked: {error.strerror or error}; expected a writable folder on a "
        "local disk (XDG_STATE_HOME), because a hold has to survive the process"
    )


@contextmanager
def live_state(
    folder: Path,
    key: InstanceKey,
    used: UsedValues,
    *,
    clock_ns: Callable[[], int],
    log: Callable[[str], None],
) -> Iterator["LiveState"]:
    """Lock the namespace and the arm of ``key``, read how the last run ended, note that one runs.

    ``used`` are the values that this run begins with. ``clock_ns`` is the system time. ``log`` gets
    a line if a record cannot be written later.

    Raises `SecondInstanceError` if another guard runs, and `StateFileError` if ``folder`` cannot
    be written: a guard that cannot keep a hold does not start.
    """
    with ExitStack() as opened:
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise StateFileError(
                f"{folder} cannot be written: {error.strerror}; expected a writable folder "
                "(XDG_STATE_HOME), because a hold has to survive the process"
            ) from error
        holder = describe_holder(key.namespace, key.arm)
        locks: dict[Slot, InstanceLock] = {}
        opened.callback(_close_all, locks)
        for slot in key.slots:
            locks[slot] = InstanceLock(lock_path(folder, slot), slot, holder)
        state = LiveState(folder, key, used, locks, clock_ns=clock_ns, log=log)
        try:
            yield state
        finally:
            state.close()


class LiveState:
    """Use `live_state`. The files say that the run has not ended, until `close` after `end`.

    So a killed process leaves a record that makes the next run begin on hold, at whatever moment it
    is killed, and although `update` never waits for the disk. ``start_causes`` is empty if the run
    may begin without hold. ``problem`` is not empty while another guard has the lock, because the
    file of this one was removed.
    """

    def __init__(
        self,
        folder: Path,
        key: InstanceKey,
        used: UsedValues,
        locks: dict[Slot, InstanceLock],
        *,
        clock_ns: Callable[[], int],
        log: Callable[[str], None],
    ) -> None:
        self._folder = folder
        self._key = key
        self._locks = locks
        self._clock_ns = clock_ns
        self._log = log
        self.problem = ""
        self.start_causes, since_ns = self._read(used)
        now_ns = clock_ns()
        hold = HoldRecord(since_ns or now_ns, self.start_causes) if self.start_causes else None
        self._record = RunRecord(
            key, os.getpid(), now_ns, now_ns, ended=False, hold=hold, used=used
        )
        # Before the first step: nothing is permitted while the files say that no guard runs.
        self._write(self._record)
        self._record = replace(self._record, ended=True)  # written by `close` if no step follows
        self._writer = RecordWriter(self._write, self._beat, self._failed)

    def use(self, used: UsedValues) -> None:
        """Note the values in use, which an operator may have changed. Returns at once."""
        if used == self._record.used:
            return
        self._record = replace(self._record, used=used, written_ns=self._clock_ns())
        self._writer.put(replace(self._record, ended=False))

    def update(self, latched: bool, causes: tuple[str, ...]) -> None:
        """Note after a step whether a hold is latched, and its causes. Returns at once."""
        hold = self._record.hold
        if not latched:
            if hold is None:
                return
            new = None
        elif hold is None:
            new = HoldRecord(self._clock_ns(), causes)
        elif hold.causes == causes:
            return
        else:
            new = HoldRecord(hold.since_ns, causes)
        self._record = replace(self._record, hold=new, written_ns=self._clock_ns())
        self._writer.put(replace(self._record, ended=False))

    def end(self, latched: bool, causes: tuple[str, ...] = ()) -> None:
        """Note an orderly end of the steps; `close` writes it. Undone by `resume`."""
        self.update(latched, causes)
        self._record = replace(self._record, ended=True)

    def resume(self) -> None:
        """Note that steps follow, for the first time or after `end`."""
        self._record = replace(self._record, ended=False)
        self._writer.put(self._record)

    def close(self) -> None:
        """Write the final record and end the thread; the locks are released afterwards."""
        self._record = replace(self._record, written_ns=self._clock_ns())
        if not self._writer.close(self._record):
            self._log("the state folder does not answer: the next start will be on hold")

    def _read(self, used: UsedValues) -> tuple[tuple[str, ...], int | None]:
        """Causes of a hold at the start, and since when it has been latched."""
        causes: dict[str, None] = {}
        since: list[int] = []
        seen = [lock.last_alive_ns for lock in self._locks.values()]
        alive_ns = max(filter(None, seen), default=None)
        for slot in self._locks:
            try:
                record = read_record(record_path(self._folder, slot), slot)
            except StateFileError as error:
                causes |= dict.fromkeys(causes_of_damage(error))
                continue
            if record is not None:
                found = causes_of_record(record, alive_ns)
                # Before the earlier causes: of too many the last ones are not displayed.
                changes = causes_of_change(record.used, used)
                causes |= dict.fromkeys((*found[:1], *changes, *found[1:]))
                if record.hold is not None:
                    since.append(record.hold.since_ns)
        return tuple(causes), min(since, default=None)

    def _write(self, record: RunRecord) -> None:
        self._last = record
        for slot in self._locks:
            write_durably(record_path(self._folder, slot), as_bytes(record), StateFileError)

    def _beat(self) -> None:
        for slot, lock in self._locks.items():
            if lock.is_removed:
                self._restore(slot)
            self._locks[slot].touch()

    def _restore(self, slot: Slot) -> None:
        """Lock ``slot`` again after its file was removed, and write its record again."""
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        holder = describe_holder(self._key.namespace, self._key.arm)
        try:
            restored = InstanceLock(lock_path(self._folder, slot), slot, holder)
        except SecondInstanceError as error:
            self.problem = str(error)
            return
        self._locks[slot].close()
        self._locks[slot], self.problem = restored, ""
        self._write(self._last)  # not a newer one, whose run may have ended without a `close`

    def _failed(self, why: str) -> None:
        self._log(f"{why}; a restart will begin on hold, without the causes of later holds")


class RecordWriter:
    """Calls ``write(record)`` in a thread of its own, for the newest record only.

    `put` returns at once, whatever the disk does. ``beat()`` is called every `BEAT_S` and after
    each write. The first failure of either is passed to ``failed`` in that thread; later ones are
    silent until one succeeds.
    """

    def __init__(
        self,
        write: Callable[[RunRecord], None],
        beat: Callable[[], None],
        failed: Callable[[str], None],
    ) -> None:
        self._write = write
        self._beat = beat
        self._failed = failed
        self._newest: deque[RunRecord] = deque(maxlen=1)
        self._woken = threading.Event()
        self._closing = threading.Event()
        self._has_failed = False
        self._thread = threading.Thread(target=self._work, name="hold record", daemon=True)
        self._thread.start()

    def put(self, record: RunRecord) -> None:
        """Write ``record`` soon; it replaces one that has not been written yet."""
        self._newest.append(record)
        self._woken.set()

    def close(self, last: RunRecord) -> bool:
        """Write ``last`` and end the thread; False if the disk takes longer than 5 s."""
        self._newest.append(last)
        self._closing.set()
        self._woken.set()
        self._thread.join(_CLOSE_S)
        return not self._thread.is_alive()

    def _work(self) -> None:
        while True:
            is_last = self._closing.is_set()
            self._woken.wait(0.0 if is_last else BEAT_S)
            self._woken.clear()
            try:
                if self._newest:
                    self._write(self._newest.pop())
                self._beat()
                self._has_failed = False
            except (MarginGuardError, OSError) as error:
                if not self._has_failed:
                    self._has_failed = True
                    self._failed(str(error))
            if is_last:
                return


def _close_all(locks: dict[Slot, InstanceLock]) -> None:
    for lock in locks.values():
        lock.close()


def refuse_beside_guard(folder: Path, key: InstanceKey) -> None:
    """Raise `SecondInstanceError` if a guard has the namespace of ``key``.

    For replays, which publish its topics. Changes nothing on disk.
    """
    namespace = key.slots[0]
    check_no_guard(lock_path(folder, namespace), namespace)


def lock_path(folder: Path, slot: Slot) -> Path:
    """The lock of ``slot``."""
    return folder / f"{slot.stem}.lock"


def record_path(folder: Path, slot: Slot) -> Path:
    """The record of the last run with ``slot``."""
    return folder / f"{slot.stem}.json"
