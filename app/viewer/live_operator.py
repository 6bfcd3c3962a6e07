"""The operator of a live session's page: what the page requests of the session."""

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

from app.case import DISPLAY_ITEMS, ItemKind
from app.geometry import MarginGuardError
from app.runtime import (
    Operator,
    OperatorCommand,
    OperatorRequest,
    RecordingStatus,
    RequestKind,
    SessionContent,
)
from app.viewer.log import log

_Value = TypeVar("_Value")

THE_PAGE = "the page"
"""Origin of what its session has not listed."""

_QUEUED = frozenset(
    {RequestKind.NOTE, *(each.command for each in DISPLAY_ITEMS if each.kind is ItemKind.ROD)}
)
"""Kinds that a page sends one after the other. Another request of the others has to wait."""


class LiveOperator:
    """Sends requests of a page to a session. The page exists before the session: see `connect`.

    A request waits for its outcome in a thread of its kind, and not in the page's. ``refused``
    gets each one that was refused or got no answer, to be shown; an accepted one is shown with the
    session's next step. ``clock_ns`` is the system time.
    """

    def __init__(
        self,
        refused: Callable[[OperatorRequest], None],
        clock_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._refused, self._clock_ns = refused, clock_ns
        self._operator: Operator | None = None
        self._threads: dict[str, ThreadPoolExecutor] = {}
        self._running: dict[str, Future[None]] = {}

    def connect(self, operator: Operator) -> None:
        """Send requests to this session from now on."""
        self._operator = operator

    @property
    def content(self) -> SessionContent | None:
        """The content of the session; None before `connect`."""
        return None if self._operator is None else self._operator.content

    @property
    def recording(self) -> RecordingStatus | None:
        """State of the last recording; None before the first."""
        return None if self._operator is None else self._operator.recording

    def request(self, command: OperatorCommand) -> bool:
        """Begin to carry ``command`` out.

        False before `connect`, and while an earlier one of the kind runs that does not queue.
        """
        kind, operator = command.kind, self._operator
        running = self._running.get(kind)
        if operator is None or (running and not running.done() and kind not in _QUEUED):
            return False
        if kind not in self._threads:
            self._threads[kind] = ThreadPoolExecutor(1, thread_name_prefix=f"request {kind}")
        self._running[kind] = self._threads[kind].submit(self._send, operator, command)
        return True

    def compute(self, function: Callable[..., _Value], /, *args: Any) -> _Value:
        """Return ``function(*args)``, computed where it does not delay the page."""
        operator = self._operator
        return function(*args) if operator is None else operator.compute(function, *args)

    def close(self) -> None:
        """Send nothing more; what waits is dropped."""
        for thread in self._threads.values():
            thread.shutdown(wait=False, cancel_futures=True)

    def _send(self, operator: Operator, command: OperatorCommand) -> None:
        try:
            operator.request(command)
        except MarginGuardError as error:
            self._tell(command.kind, str(error))
        except Exception as error:  # the page shows any failure
            log.exception("request %s", command.kind)
            self._tell(command.kind, f"unexpected {type(error).__name__}: see the log")

    def _tell(self, kind: str, text: str) -> None:
        self._refused(OperatorRequest(kind, THE_PAGE, False, text, self._clock_ns()))
