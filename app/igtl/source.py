"""Receive from an OpenIGTLink server in a thread, with automatic reconnection.

The client of pyigtl is not suitable: it does not detect a closed connection (an empty read means
"no data yet"), loses synchronisation when a header arrives in two parts, reads bodies of any size,
and must be polled.
"""

import socket
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Self

from app.geometry import NS_PER_S, TrackedTransform
from app.igtl.framing import (
    MAX_STRING_BODY_BYTES,
    IgtlError,
    IgtlFramingError,
    MessageStream,
    Refusals,
    Unread,
    start_tracking_request,
)
from app.igtl.image_messages import MAX_IMAGE_BODY_BYTES
from app.igtl.pose_messages import TYPES, PoseReader

SILENCE_S = 5.0
"""Silence after which a server counts as lost; PLUS sends a keep-alive message every 0.5 s."""

_CONNECT_TIMEOUT_S = 3.0
_RECEIVE_BYTES = 1 << 16


class Backoff:
    """Delay that starts at ``first_s``, doubles each time and is limited to ``max_s``."""

    def __init__(self, first_s: float = 0.25, max_s: float = 5.0) -> None:
        if not 0.0 < first_s <= max_s:
            raise IgtlError(
                f"backoff delays are {first_s} s to {max_s} s; expected 0 < first_s <= max_s"
            )
        self._first_s = first_s
        self._max_s = max_s
        self._next_s = first_s

    def next_s(self) -> float:
        """Return the current delay and double it for the next call."""
        delay_s = self._next_s
        self._next_s = min(2.0 * delay_s, self._max_s)
        return delay_s

    def reset(self) -> None:
        """Start again at ``first_s``, after a successful attempt."""
        self._next_s = self._first_s


class IgtlSource:
    """``with IgtlSource(host, port, deliver): ...`` passes received samples to ``deliver``.

    ``deliver(samples)`` is called in the thread of the source with the samples of one read. It
    must return quickly, because samples in the socket age meanwhile. ``changed(status)`` is called
    in that thread when the connection is established, lost, or refused. A server that sends no
    complete message for ``silence_s`` counts as lost. The source reconnects indefinitely, with the
    delays of ``backoff``. The first complete message resets them, not the connection itself, which
    any server accepts. ``images(header, body)`` takes each IMAGE message as it came, in the thread
    of the source, and ``strings`` each STRING message; without them they are skipped. An exception
    in a function ends the thread and is raised by the next `counts` or by `close`.
    """

    def __init__(
        self,
        host: str,
        port: int,
        deliver: Callable[[Sequence[TrackedTransform]], None],
        *,
        changed: Callable[[str], None] = lambda status: None,
        backoff: Backoff | None = None,
        silence_s: float = SILENCE_S,
        images: Unread | None = None,
        strings: Unread | None = None,
    ) -> None:
        if not host or not 0 < port < 1 << 16:
            raise IgtlError(
                f"server is {host!r} port {port}; expected a host name and a port from 1 to 65535"
            )
        if not silence_s > 0.0:
            raise IgtlError(f"silence_s is {silence_s}; expected more than 0")
        self._unread = {} if images is None else {"IMAGE": (images, MAX_IMAGE_BODY_BYTES)}
        if strings is not None:
            self._unread["STRING"] = (strings, MAX_STRING_BODY_BYTES)
        self._address = (host, port)
        self._deliver = deliver
        self._changed = changed
        self._backoff = backoff or Backoff()
        self._silence_ns = round(silence_s * NS_PER_S)
        self._refusals = Refusals()
        self._reader = PoseReader(self._refusals)
        self._status = f"connecting to {host}:{port}"
        self._connected = False
        self._counts = dict.fromkeys(
            ("connections", "messages", "messages of other types", "samples"), 0
        )
        self._error: Exception | None = None
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._thread = threading.Thread(target=self._run, name="OpenIGTLink", daemon=True)
        self._thread.start()

    @property
    def connected(self) -> bool:
        """True while connected to the server."""
        return self._connected

    @property
    def status(self) -> str:
        """Description of the connection, or the reason why there is none."""
        return self._status

    @property
    def problem(self) -> str:
        """The reason why the server sends nothing, with what to do; empty while it is connected."""
        if self._connected:
            return ""
        host, port = self._address
        return (
            f"OpenIGTLink server {host}:{port}: {self._status}; expected a running server: start "
            "it, or correct host and port of the source"
        )

    @property
    def last_refusal(self) -> str:
        """The reason why the latest invalid message was refused."""
        return self._refusals.last

    def counts(self) -> Mapping[str, int]:
        """Counters of received and refused messages, for diagnostics."""
        self._raise_error()
        counts = {
            "connected": int(self._connected),
            **self._counts,
            "samples without a status": self._reader.without_status,
        }
        for kind, count in dict(self._refusals.counts).items():
            counts[f"refused ({kind})"] = count
        return {f"OpenIGTLink: {name}": count for name, count in counts.items()}

    def close(self) -> None:
        """Disconnect and end the thread; nothing is delivered afterwards."""
        self._closing.set()
        with self._lock:
            if self._socket is not None:
                with suppress(OSError):  # the server may have disconnected first
                    self._socket.shutdown(socket.SHUT_RDWR)
        if threading.current_thread() is not self._thread:
            self._thread.join()
        self._raise_error()

    def _run(self) -> None:
        try:
            self._stay_connected()
        except Exception as error:  # raised later in the caller's thread
            self._connected, self._error = False, error

    def _stay_connected(self) -> None:
        host, port = self._address
        while not self._closing.is_set():
            try:
                with socket.create_connection(self._address, _CONNECT_TIMEOUT_S) as server:
                    self._receive(server)
                reason = "closed by the server"
            except IgtlFramingError as error:
                reason = str(error)
                self._refusals.add(error)
            except (OSError, UnicodeError) as error:  # socket error, invalid host name
                reason = str(error)
            if self._closing.is_set():
                return
            delay_s = self._backoff.next_s()
            what = "lost" if self._connected else "cannot reach"
            self._connected = False
            self._set_status(f"{what} {host}:{port}: {reason}; retrying in {delay_s:g} s")
            self._closing.wait(delay_s)

    def _receive(self, server: socket.socket) -> None:
        with self._lock:
            self._socket = server
        try:
            if self._closing.is_set():
                return
            server.settimeout(_CONNECT_TIMEOUT_S)
            server.sendall(start_tracking_request())
            self._connected = True
            self._counts["connections"] += 1
            self._set_status(f"connected to {self._address[0]}:{self._address[1]}")
            self._read_messages(server)
        finally:
            with self._lock:
                self._socket = None

    def _read_messages(self, server: socket.socket) -> None:
        stream = MessageStream(TYPES, self._refusals, unread=self._unread)
        complete = 0
        silent_ns = time.monotonic_ns() + self._silence_ns
        while True:
            remaining_ns = silent_ns - time.monotonic_ns()
            if remaining_ns <= 0:
                raise TimeoutError(f"no message for {self._silence_ns / NS_PER_S:g} s")
            server.settimeout(remaining_ns / NS_PER_S)
            try:
                data = server.recv(_RECEIVE_BYTES)
            except TimeoutError:
                continue
            if not data or self._closing.is_set():
                return
            ignored = stream.ignored
            messages = stream.feed(data)
            self._counts["messages of other types"] += stream.ignored - ignored
            self._counts["messages"] += len(messages)
            if stream.complete > complete:
                complete = stream.complete
                silent_ns = time.monotonic_ns() + self._silence_ns
                self._backoff.reset()
            samples = [sample for message in messages for sample in self._reader.read(message)]
            if samples:
                self._counts["samples"] += len(samples)
                self._deliver(samples)

    def _raise_error(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise IgtlError(f"the OpenIGTLink thread ended: {error}") from error

    def _set_status(self, status: str) -> None:
        self._status = status
        self._changed(status)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class SampleQueue:
    """FIFO queue that keeps only the newest sample of each edge on overflow.

    The queue overflows above ``max_samples``; it then holds one sample per edge. `superseded`
    counts the samples that were dropped for a newer one of the same edge.
    """

    def __init__(self, max_samples: int = 1_000) -> None:
        self.superseded = 0
        self._max_samples = max_samples
        self._samples: list[TrackedTransform] = []
        self._changed = threading.Condition()
        self._closed = False

    def put(self, samples: Sequence[TrackedTransform]) -> None:
        """Add ``samples`` and wake the thread that waits in `take`."""
        with self._changed:
            self._samples += samples
            if len(self._samples) > self._max_samples:
                newest = {(each.target, each.source): each for each in self._samples}
                self.superseded += len(self._samples) - len(newest)
                self._samples = list(newest.values())
            self._changed.notify()

    def clear(self) -> None:
        """Discard all samples, after the connection was lost."""
        with self._changed:
            self._samples = []

    def close(self) -> None:
        """End every `take`."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def take(self, timeout_s: float) -> list[TrackedTransform] | None:
        """Wait up to ``timeout_s`` and remove all samples; None if the queue is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._samples or self._closed, timeout_s)
            if self._closed:
                return None
            taken, self._samples = self._samples, []
            return taken
