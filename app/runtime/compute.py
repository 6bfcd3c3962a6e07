"""Call a function that computes for seconds: here, or in a process of low priority.

In the process of a live session, a computation competes with the thread that sends the constraint
for the interpreter lock and for the processors. In a process of its own, with a lower priority, it
does neither.
"""

import gc
import logging
import mmap
import os
import pickle
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol, Self, TypeVar, cast

from app.files.child_process import module_command, same_code, work_behind
from app.geometry import InputError, MarginGuardError

_LOG = logging.getLogger(__name__)

_Value = TypeVar("_Value")

_CLOSE_INTERVAL_S = 0.05
_ALIGNMENT = 64
_COUNT = struct.Struct("<Q")


class Compute(Protocol):
    """Returns ``function(*args)``, or raises its `MarginGuardError`."""

    def __call__(self, function: Callable[..., _Value], /, *args: Any) -> _Value:
        """Call ``function``."""


def call_when_idle(function: Callable[[], object]) -> None:
    """Call ``function`` in a thread that runs only while a processor has nothing else to do."""

    def work() -> None:
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))  # of this thread alone
        function()

    with ThreadPoolExecutor(max_workers=1) as other_thread:
        other_thread.submit(work).result()


def compute_here(function: Callable[..., _Value], /, *args: Any) -> _Value:
    """Call ``function`` in this thread."""
    return function(*args)


class ComputeProcess:
    """A process that computes for this one. Ends with `close`, and when this process has ended.

    It starts with the first call or by `start_after`, and again if it has ended by itself. One call
    runs at a time; other threads wait. The function, its arguments and its result are pickled; the
    arrays of the result are not copied here, but mapped.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._closed = False
        self._process: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None
        self._timer: threading.Timer | None = None
        self._called = False
        self._loading: subprocess.Popen[bytes] | None = None

    def start_after(self, delay_s: float, load: Callable[[], object]) -> None:
        """Start the process after ``delay_s`` and call ``load`` there while a processor is idle.

        ``load`` loads what the first call would wait for. A call that comes earlier ends the
        process and starts another: on a busy machine it would wait long.
        """
        self._timer = threading.Timer(delay_s, self._load, (load,))
        self._timer.daemon = True
        self._timer.start()

    def call(self, function: Callable[..., _Value], /, *args: Any) -> _Value:
        """Return ``function(*args)``, or raise its `MarginGuardError`.

        Raises `InputError` if the process ended meanwhile, and `RuntimeError` for another error of
        the function, which the process has logged.
        """
        self._called = True
        if (loading := self._loading) is not None:
            loading.kill()
        with self._lock:
            if self._closed:
                raise InputError("computing process: is closed; expected an open one")
            process, connection = self._started()
            succeeded, result = _exchange(process, connection, (function, args))
        if not succeeded:
            raise result
        return cast(_Value, result)

    def close(self) -> None:
        """End the process, also during a call, which then raises `InputError`."""
        self._closed = True
        if self._timer is not None:
            self._timer.cancel()
        while not self._lock.acquire(timeout=_CLOSE_INTERVAL_S):
            if self._process is not None:
                self._process.kill()  # so that a call ends, which holds the lock
        try:
            if self._process is not None:
                self._process.kill()
                self._process.wait()
            if self._socket is not None:
                self._socket.close()
        finally:
            self._lock.release()
        if self._timer is not None:
            self._timer.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _load(self, load: Callable[[], object]) -> None:
        with self._lock:
            if self._closed or self._called:
                return
            self._loading, connection = self._started()
            try:
                if self._called or self._closed:  # before it could be seen that this is loading
                    return
                succeeded, result = _exchange(self._loading, connection, (call_when_idle, (load,)))
            except InputError:
                return  # ended by a call or by `close`, or by itself: the next call starts another
            finally:
                self._loading = None
        if not succeeded:
            _LOG.warning("computing process: not loaded: %s", result)

    def _started(self) -> tuple["subprocess.Popen[bytes]", socket.socket]:
        """The running process and the connection to it. Called with the lock."""
        if self._process is None or self._socket is None or self._process.poll() is not None:
            if self._socket is not None:
                self._socket.close()
            self._process, self._socket = _start()
        return self._process, self._socket


def _start() -> tuple["subprocess.Popen[bytes]", socket.socket]:
    here, there = socket.socketpair()
    with there:
        process = subprocess.Popen(
            module_command("app.runtime.compute", str(there.fileno())),
            pass_fds=[there.fileno()],
            stdin=subprocess.DEVNULL,
            env=same_code(),
        )
    work_behind(process)
    return process, here


def _exchange(
    process: "subprocess.Popen[bytes]", connection: socket.socket, request: object
) -> tuple[bool, Any]:
    try:
        send_object(connection, request)
        reply = receive_object(connection)
    except OSError:
        reply = None
    if reply is None:
        raise InputError(
            f"computing process: ended with status {process.wait()}; expected a result (nothing "
            "has changed)"
        )
    return cast(tuple[bool, Any], reply)


def send_object(connection: socket.socket, value: object) -> None:
    """Send an object; its arrays are written to memory that the receiver maps."""
    file = write_object(value)
    try:
        socket.send_fds(connection, [b"x"], [file])
    finally:
        os.close(file)


def receive_object(connection: socket.socket) -> object | None:
    """Wait for an object of `send_object`; None if the sender has ended."""
    _, files, _, _ = socket.recv_fds(connection, 1, 1)
    if not files:
        return None
    try:
        return read_object(files[0])
    finally:
        os.close(files[0])


def write_object(value: object) -> int:
    """Pickle ``value`` into a new memory file; returns its descriptor, which the caller closes.

    Writing the arrays releases the GIL.
    """
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    parts = [memoryview(pickled), *(buffer.raw() for buffer in buffers)]
    file = os.memfd_create("marginguard", os.MFD_CLOEXEC)
    try:
        offset = 0
        for data in (_COUNT.pack(len(parts)), *(_COUNT.pack(part.nbytes) for part in parts)):
            offset += os.pwrite(file, data, offset)
        for part in parts:
            offset = _aligned(offset)
            done = 0
            while done < part.nbytes:
                done += os.pwrite(file, part[done:], offset + done)
            offset += done
        os.ftruncate(file, max(offset, 1))
    except BaseException:
        os.close(file)
        raise
    return file


def read_object(file: int) -> object:
    """Return the object of `write_object`. Its arrays are views of the file, copied on write.

    Only for a file of a process that this one trusts: unpickling can run code.
    """
    content = memoryview(mmap.mmap(file, 0, access=mmap.ACCESS_COPY))
    count = _COUNT.unpack_from(content)[0]
    sizes = [_COUNT.unpack_from(content, _COUNT.size * (1 + k))[0] for k in range(count)]
    parts, offset = [], _COUNT.size * (1 + count)
    for size in sizes:
        offset = _aligned(offset)
        parts.append(content[offset : offset + size])
        offset += size
    value: object = pickle.loads(parts[0], buffers=parts[1:])
    return value


def _aligned(offset: int) -> int:
    return -(-offset // _ALIGNMENT) * _ALIGNMENT


def serve(connection: socket.socket) -> None:
    """Answer the calls that arrive on ``connection`` until it is closed."""
    while (request := receive_object(connection)) is not None:
        function, args = cast(tuple[Callable[..., object], tuple[object, ...]], request)
        reply: tuple[bool, object]
        try:
            reply = (True, function(*args))
        except MarginGuardError as error:
            reply = (False, error)
        except Exception as error:  # the caller reports any failure, and the next call follows
            _LOG.exception("%s failed", function)
            reply = (False, RuntimeError(f"{type(error).__name__}: {error}"))
        send_object(connection, reply)
        del request, args, reply
        gc.collect()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal: the session ends this process
    with socket.socket(fileno=int(sys.argv[1])) as parent:
        serve(parent)
