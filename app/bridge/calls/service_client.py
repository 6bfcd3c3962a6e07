"""Calls to a service of another node that end: with a reply, or with a reason."""

import math
import threading
from collections import deque
from collections.abc import Mapping
from typing import Any

from rclpy.task import Future

from app.bridge.calls.errors import CallError, CallTimeoutError
from app.bridge.calls.pending import Pending
from app.bridge.calls.waiting import (
    DEFAULT_TIMEOUT_S,
    SENDING_ERRORS,
    Deadline,
    ServerWait,
    is_served,
)
from app.bridge.convert.plain import from_plain
from app.bridge.convert.types import service_type
from app.bridge.errors import reason_of
from app.bridge.node import RosNode

_MOST_OPEN = 1000
_MOST_ABANDONED = 100


class ServiceClient:
    """``ServiceClient(ros, "std_srvs/srv/Trigger", "/robot/home").call(Trigger.Request())``.

    A reply that comes after its caller gave up is not lost silently: it is said in the log and
    counted in `late_replies`. Of those that never come, the newest hundred are remembered;
    `forgotten` counts the others.
    """

    def __init__(self, ros: RosNode, service: str | type, name: str) -> None:
        self.type = service_type(service)
        self._ros = ros
        try:
            self._client = ros.node.create_client(self.type, name)
        except Exception as error:  # rclpy has an unrelated type for each way to be invalid
            raise CallError(f"no client for a service {name!r}: {reason_of(error)}") from error
        self.name = str(self._client.service_name)
        self.late_replies = 0
        self.forgotten = 0
        self._server = ServerWait(ros, lambda: self.is_there, f"service {self.name}")
        self._closed = False
        self._lock = threading.Lock()
        self._open: set[Future] = set()
        self._abandoned: deque[Future] = deque()

    @property
    def is_there(self) -> bool:
        """Whether somebody serves it now."""
        with self._lock:
            return not self._closed and is_served(self._ros, self._client.service_is_ready)

    def wait(self, timeout_s: float, cancel: threading.Event | None = None) -> None:
        """Return once somebody serves it; raises `NotThereError`."""
        self._server.wait(Deadline(timeout_s, cancel))

    def call(
        self,
        request: Any,
        timeout_s: float = DEFAULT_TIMEOUT_S,
        cancel: threading.Event | None = None,
        *,
        repeat_s: float = math.inf,
    ) -> Any:
        """The reply to ``request``; ``timeout_s`` is for finding the server and its answer.

        Setting ``cancel`` ends the wait from another thread. A request that does no harm twice may
        be sent again every ``repeat_s``: a server that has not discovered us yet drops its reply,
        which ROS tells nobody, so that a request that is sent once may end with its timeout.
        Raises `NotThereError`, `ServerGoneError`, `CallTimeoutError`, `CallCancelledError`.
        """
        limit = Deadline(timeout_s, cancel)
        self._server.wait(limit, settle=repeat_s > timeout_s)
        while True:
            pending = self.start(request)
            try:
                return pending.result(min(limit.remaining_s, repeat_s), cancel)
            except CallTimeoutError:
                if limit.remaining_s == 0.0:
                    what = f"service {self.name}: no reply within {timeout_s:g} s"
                    raise CallTimeoutError(what) from None
            finally:
                pending.cancel()  # does nothing when the reply has come

    def start(self, request: Any) -> Pending:
        """Send ``request`` and return at once, whether a server is there or not.

        The request is a message, as ROS has it, or plain values with lengths in mm, which are
        checked against the fields; `app.bridge.convert.to_plain` turns the reply.
        """
        if isinstance(request, Mapping):
            request = from_plain(self.type.Request, request)
        if not isinstance(request, self.type.Request):
            raise CallError(
                f"{self.name}: a {type(request).__name__} is no request of {self.type.__name__}"
            )
        with self._lock:
            if len(self._open) >= _MOST_OPEN:
                raise CallError(f"{self.name}: {_MOST_OPEN} calls wait for a reply already")
            if self._closed or not self._ros.is_open:
                what = "client" if self._closed else "node"
                raise CallError(f"service {self.name}: the {what} is closed")
            try:
                future = self._client.call_async(request)
            except SENDING_ERRORS as error:
                reason = reason_of(error)
                raise CallError(f"{self.name}: the request cannot be sent: {reason}") from error
            self._open.add(future)
        future.add_done_callback(self._take)
        return Pending(
            self._ros,
            future,
            f"service {self.name}",
            there=lambda: self.is_there,
            abandon=lambda: self._abandon(future),
        )

    def close(self) -> None:
        """Leave the graph; a call under way ends, since nobody is there for it any more."""
        with self._lock:
            if self._ros.is_open and not self._closed:
                self._ros.node.destroy_client(self._client)
            self._closed = True

    def _take(self, future: Future) -> None:
        with self._lock:
            self._open.discard(future)
            late = future in self._abandoned
            if late:
                self._abandoned.remove(future)
        if late:
            # Said before it is counted: whoever sees the count finds the words.
            self._ros.node.get_logger().warning(
                f"service {self.name}: a reply came after its caller had given up",
                throttle_duration_sec=1.0,
            )
            with self._lock:
                self.late_replies += 1

    def _abandon(self, future: Future) -> None:
        with self._lock:
            if future not in self._open:
                return
            self._open.discard(future)
            self._abandoned.append(future)
            if len(self._abandoned) <= _MOST_ABANDONED:
                return
            oldest = self._abandoned.popleft()
            self.forgotten += 1
        self._client.remove_pending_request(oldest)
