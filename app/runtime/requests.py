"""Requests of operators to a session: how many are processed, and what became of each."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

from app.case import DISPLAY_ITEMS, ItemKind
from app.geometry import NS_PER_S, MarginGuardError


class TooManyRequestsError(MarginGuardError):
    """A kind of request is sent faster than it is processed."""


class RateLimit:
    """A token bucket: ``burst`` units at once, ``per_s`` units a second in the long run.

    Times are those of one steady clock, in ns.
    """

    def __init__(self, per_s: float, burst: float) -> None:
        self._per_s = per_s
        self._burst = burst
        self._left = burst
        self._last_ns: int | None = None

    def take(self, now_ns: int, cost: float = 1.0) -> bool:
        """Use ``cost`` units; return False, and use none, if fewer are left."""
        if not self.has(now_ns, cost):
            return False
        self._left -= cost
        return True

    def admit(self, kind: str, now_ns: int) -> None:
        """Use a unit for a request of ``kind``. Raises `TooManyRequestsError` if none is left."""
        if not self.take(now_ns):
            raise TooManyRequestsError(
                f"{kind}: too many requests; expected at most {self._burst:g} at once and "
                f"{self._per_s:g} per second"
            )

    def has(self, now_ns: int, cost: float = 1.0) -> bool:
        """True if `take` would return True."""
        self._refill(now_ns)
        return self._left >= cost

    def _refill(self, now_ns: int) -> None:
        if self._last_ns is not None:
            gained = max(now_ns - self._last_ns, 0) * (self._per_s / NS_PER_S)
            self._left = min(self._left + gained, self._burst)
        self._last_ns = now_ns


MAX_TEXT_CHARS = 1000
"""Longer texts are cut off: they may contain what another process sent."""


class RequestKind(StrEnum):
    """Kind of an operator's request; `DisplayItem.command` has those of the display items."""

    REARM = "rearm"
    MARGINS = "set_margins"
    TUMOR = "set_tumor"
    STRUCTURE = "set_structure"
    SWITCH = "switch_structure"
    """A structure is guarded no more, or again."""
    REGISTRATION = "register"
    RECORD = "record"
    TIP = "set_tip"
    """The calibrated tip of the tool."""
    DEPTH = "image_depth"
    """Imaging depth of the ultrasound: by which calibration images are placed."""
    NOTE = "note"
    """A text on the present, which changes nothing."""


KINDS = (*RequestKind, *(each.command for each in DISPLAY_ITEMS))
"""The kinds of all requests."""


@dataclass(frozen=True, slots=True)
class OperatorRequest:
    """A request and its outcome. ``origin`` is the interface on which it arrived, not a person.

    ``text`` is what was changed, or why the request was refused. ``not_listed`` counts refused
    requests of this kind since the last one that was listed. ``time_ns`` is the system time.
    """

    kind: str
    origin: str
    accepted: bool
    text: str
    time_ns: int
    not_listed: int = 0

    @property
    def line(self) -> str:
        """One line for logs and displays."""
        outcome = "accepted" if self.accepted else "REFUSED"
        more = f" ({self.not_listed} more refused before)" if self.not_listed else ""
        return f"{self.kind} from {self.origin} {outcome}: {self.text}{more}"


Listener = Callable[[OperatorRequest], None]


class Allowed(NamedTuple):
    """A rate: ``burst`` requests at once, ``per_s`` a second in the long run."""

    per_s: float
    burst: float


ADMITTED: dict[str, Allowed] = {
    RequestKind.MARGINS: Allowed(per_s=2.0, burst=20.0),
    RequestKind.TUMOR: Allowed(per_s=0.2, burst=5.0),
    RequestKind.STRUCTURE: Allowed(per_s=0.2, burst=5.0),
    RequestKind.SWITCH: Allowed(per_s=0.5, burst=5.0),
    RequestKind.REGISTRATION: Allowed(per_s=0.5, burst=5.0),
    RequestKind.RECORD: Allowed(per_s=0.5, burst=5.0),
    RequestKind.TIP: Allowed(per_s=0.5, burst=5.0),
    RequestKind.NOTE: Allowed(per_s=2.0, burst=20.0),
    RequestKind.DEPTH: Allowed(per_s=2.0, burst=20.0),
    **{
        each.command: Allowed(per_s=10.0, burst=50.0)
        if each.kind is ItemKind.ROD
        else Allowed(per_s=0.5, burst=5.0)
        for each in DISPLAY_ITEMS
    },
}
"""Requests of other processes that are processed. A re-arm is always checked, because a limit that
others can use up would delay a valid one; the check of an invalid one costs microseconds."""

LISTED = Allowed(per_s=1.0, burst=10.0)
"""Refused requests of each kind that are listed. Accepted ones are listed always."""


class RequestLog:
    """Lists requests: the last one for displays, each for the listeners. Thread-safe.

    ``clock_ns`` is the system time, ``steady_ns`` a steady clock. A flood of refused requests is
    counted instead of listed. A listener is called in the thread of the request and must not wait.
    """

    def __init__(self, clock_ns: Callable[[], int], steady_ns: Callable[[], int]) -> None:
        self._clock_ns = clock_ns
        self._steady_ns = steady_ns
        self._lock = threading.Lock()
        self._admitted = {kind: RateLimit(*allowed) for kind, allowed in ADMITTED.items()}
        self._listed = {kind: RateLimit(*LISTED) for kind in KINDS}
        self._not_listed = dict.fromkeys(KINDS, 0)
        self._listeners: list[Listener] = []
        self._last: OperatorRequest | None = None

    @property
    def last(self) -> OperatorRequest | None:
        """The request that was listed last; None before any."""
        return self._last

    def listen(self, listener: Listener) -> None:
        """Call ``listener`` with each listed request from now on."""
        self._listeners.append(listener)

    def admit(self, kind: str) -> None:
        """Count a request of another process. Raises `TooManyRequestsError` above the limit."""
        limit = self._admitted.get(kind)
        if limit is not None:
            with self._lock:
                limit.admit(kind, self._steady_ns())

    def accepted(self, kind: str, origin: str, text: str) -> None:
        """List an accepted request."""
        self._list(self._request(kind, origin, True, text))

    def refused(self, kind: str, origin: str, text: str) -> None:
        """List a refused request, or count it in a flood."""
        with self._lock:
            if not self._listed[kind].take(self._steady_ns()):
                self._not_listed[kind] += 1
                return
        self._list(self._request(kind, origin, False, text))

    def _request(self, kind: str, origin: str, accepted: bool, text: str) -> OperatorRequest:
        line = " ".join(text.split())
        line = "".join(each if each.isprintable() else "?" for each in line)
        if len(line) > MAX_TEXT_CHARS:
            line = f"{line[:MAX_TEXT_CHARS]} ..."
        return OperatorRequest(kind, origin, accepted, line, self._clock_ns())

    def _list(self, request: OperatorRequest) -> None:
        with self._lock:
            request = replace(request, not_listed=self._not_listed[request.kind])
            self._not_listed[request.kind] = 0
            self._last = request
            listeners = tuple(self._listeners)
        for listener in listeners:
            listener(request)
