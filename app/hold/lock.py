"""File locks: one guard for each namespace and arm on a machine.

The kernel keeps a lock (flock) as long as the process lives, and releases it at its end, also
after SIGKILL. The file itself stays: if it were removed, a third process could lock a new one.
"""

import fcntl
import os
import time
from pathlib import Path

from app.hold.instance import SecondInstanceError, Slot, StateFileError

_MAX_HOLDER_BYTES = 400
_RETRY_S = 0.2
"""A replay has a lock for some microseconds while it checks it (`check_no_guard`)."""

_EXPECTED = "expected one guard for each namespace and arm: end the other one first"


class InstanceLock:
    """The exclusive lock of ``slot`` at ``path``, held until `close`.

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
