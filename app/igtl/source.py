"""A thread that listens to an OpenIGTLink server, and finds it again when it was lost.

pyigtl's own client does not serve here: it does not notice that its server is gone (an empty read
counts as "nothing yet", for ever), loses its place in the stream when a header comes in two
pieces, reads bodies of any size, and is asked by polling.
"""

import socket
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Self

from app.geometry import NS_PER_S, TrackedTransform
from app.igtl.backoff import Backoff
from app.igtl.errors import IgtlError, IgtlFramingError
from app.igtl.poses import TYPES, PoseReader
from app.igtl.stream import MessageStream, Refusals
from app.igtl.wire import start_tracking_request

PORT = 18944
"""The port that IANA keeps for OpenIGTLink."""

SILENCE_S = 5.0
"""A PLUS server says that it is alive every half second; one that says nothing is gone."""

_CONNECT_S = 3.0
_PIECE_BYTES = 1 << 16


class IgtlSource:
    """``with IgtlSource(host, port, deliver): ...``: samples go to ``deliver`` as they come.

    ``deliver(samples)`` is called in the client's own thread with the samples of one read, none of
    a connection that is lost; it must return soon, since what waits in the socket meanwhile grows
    old. ``changed(words)`` is called in that thread when the connection comes, is lost, or is not
    to be had. A server without one whole message in ``silence_s`` is taken for lost. Attempts go on
    for ever, further and further apart as ``backoff`` has it; it starts over with the first message
    of a connection, not with the connection, which garbage can have as well. An error of either
    function ends the thread, and is raised by the next `counts` or by `close`.
    """

    def __init__(
        self,
        host: str,
        port: int,
        deliver: Callable[[Sequence[TrackedTransform]], None],
        *,
        changed: Callable[[str], None] = lambda words: None,
        backoff: Backoff | None = None,
        silence_s: float = SILENCE_S,
    ) -> None:
        if not host or not 0 < port < 1 << 16:
            raise IgtlError(f"{host!r} port {port} is no server: a name and 1 to 65535 wanted")
        if not silence_s > 0.0:
            raise IgtlError(f"silence of {silence_s} s: more than 0 wanted")
        self._address = (host, port)
        self._deliver = deliver
        self._changed = changed
        self._backoff = backoff or Backoff()
        self._silence_ns = round(silence_s * NS_PER_S)
        self._refusals = Refusals()
        self._reader = PoseReader(self._refusals)
        self._words = f"connecting to {host}:{port}"
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
        """Whether there is a server now."""
        return self._connected

    @property
    def words(self) -> str:
        """How the connection is, or why there is none."""
        return self._words

    @property
    def last_refusal(self) -> str:
        """The latest message that could not be used, and why."""
        return self._refusals.last

    def counts(self) -> Mapping[str, int]:
        """What came and what was left out, for diagnostics."""
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
        """Leave the server and end the thread: nothing is delivered afterwards."""
        self._closing.set()
        with self._lock:
            if self._socket is not None:
                with suppress(OSError):  # the server may have been faster
                    self._socket.shutdown(socket.SHUT_RDWR)
        if threading.current_thread() is not self._thread:
            self._thread.join()
        self._raise_error()

    def _run(self) -> None:
        try:
            self._stay_connected()
        except Exception as error:  # handed over to the thread that can deal with it
            self._connected, self._error = False, error

    def _stay_connected(self) -> None:
        host, port = self._address
        while not self._closing.is_set():
            try:
                with socket.create_connection(self._address, _CONNECT_S) as server:
                    self._listen(server)
                reason = "closed by the server"
            except IgtlFramingError as error:
                reason = str(error)
                self._refusals.add(error)
            except (OSError, UnicodeError) as error:  # of the socket, of a name that is none
                reason = str(error)
            if self._closing.is_set():
                return
            wait_s = self._backoff.next_s()
            what = "lost" if self._connected else "cannot reach"
            self._connected = False
            self._say(f"{what} {host}:{port}: {reason}; trying again in {wait_s:g} s")
            self._closing.wait(wait_s)

    def _listen(self, server: socket.socket) -> None:
        with self._lock:
            self._socket = server
        try:
            if self._closing.is_set():
                return
            server.settimeout(_CONNECT_S)
            server.sendall(start_tracking_request())
            self._connected = True
            self._counts["connections"] += 1
            self._say(f"connected to {self._address[0]}:{self._address[1]}")
            self._read_all(server)
        finally:
            with self._lock:
                self._socket = None

    def _read_all(self, server: socket.socket) -> None:
        stream = MessageStream(TYPES, self._refusals)
        complete = 0
        until_ns = time.monotonic_ns() + self._silence_ns
        while True:
            remaining_ns = until_ns - time.monotonic_ns()
            if remaining_ns <= 0:
                raise TimeoutError(f"no message for {self._silence_ns / NS_PER_S:g} s")
            server.settimeout(remaining_ns / NS_PER_S)
            try:
                piece = server.recv(_PIECE_BYTES)
            except TimeoutError:
                continue
            if not piece or self._closing.is_set():
                return
            ignored = stream.ignored
            messages = stream.feed(piece)
            self._counts["messages of other types"] += stream.ignored - ignored
            self._counts["messages"] += len(messages)
            if stream.complete > complete:
                complete = stream.complete
                until_ns = time.monotonic_ns() + self._silence_ns
                self._backoff.reset()
            samples = [sample for message in messages for sample in self._reader.read(message)]
            if samples:
                self._counts["samples"] += len(samples)
                self._deliver(samples)

    def _raise_error(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise IgtlError(f"listening to OpenIGTLink ended: {error}") from error

    def _say(self, words: str) -> None:
        self._words = words
        self._changed(words)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
