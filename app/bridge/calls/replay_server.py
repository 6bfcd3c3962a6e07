"""``~/replay`` and ``~/load_case``: recorded cases played for another process that asks for it."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from marginguard_msgs.action import Replay
from marginguard_msgs.srv import LoadCase

from app.bridge.calls.action_server import ActionServer, Ending, ServedGoal
from app.bridge.calls.service_server import ServiceServer
from app.bridge.messages import MM_PER_M
from app.bridge.node import RosNode
from app.fixture import MarginState
from app.geometry import InputError

FEEDBACK_HZ = 20.0
"""At most: a replay without waiting makes thousands of frames a second."""


@dataclass(frozen=True, slots=True)
class ReplayPart:
    """What is to be played: ``rate`` is None for as fast as possible, ``end_s`` may be infinite."""

    folder: str
    rate: float | None
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class ReplayProgress:
    """Where a replay stands; ``signed_distance_mm`` is None while it is not known."""

    time_s: float
    frames: int
    state: MarginState
    signed_distance_mm: float | None


@dataclass(frozen=True, slots=True)
class ReplayTotals:
    """What was played, to the end or up to where it was stopped."""

    frames: int
    breaches: int
    min_signed_distance_mm: float | None


@dataclass(frozen=True, slots=True)
class CaseInfo:
    """What a caller is told of a case that was opened; ``duration_s`` from first frame to last."""

    name: str
    frames: int
    duration_s: float


class Cases(Protocol):
    """Opens cases and plays them, in the thread that asks; the wiring is the command's."""

    def load(self, folder: str) -> CaseInfo:
        """Open the case; empty: the one that is open. Raises `MarginGuardError`."""

    def play(
        self,
        part: ReplayPart,
        tell: Callable[[ReplayProgress], None],
        stops: Callable[[Callable[[], None]], None],
    ) -> ReplayTotals:
        """Play a case, calling ``tell`` at every frame; gives ``stops`` what ends it at once."""


class ReplayServer:
    """Serves both on ``ros`` until the node is closed. One replay at a time."""

    def __init__(self, ros: RosNode, cases: Cases) -> None:
        self._cases = cases
        self._action = ActionServer(ros, Replay, "~/replay", self._run)
        self._load = ServiceServer(ros, LoadCase, "~/load_case", self._load_case, in_thread=True)

    def _load_case(self, request: LoadCase.Request, response: LoadCase.Response) -> None:
        if not request.case_folder:
            raise InputError("case_folder is empty: the folder of a case wanted")
        facts = self._cases.load(request.case_folder)
        response.success = True
        response.name = facts.name
        response.frames = facts.frames
        response.duration = facts.duration_s

    def _run(self, served: ServedGoal) -> tuple[Replay.Result, Ending]:
        goal: Replay.Goal = served.request
        part = _part(goal)
        facts = self._cases.load(part.folder)
        if not part.start_s <= facts.duration_s:
            raise InputError(
                f"start {part.start_s:g} s is after the recording's end, {facts.duration_s:g} s"
            )
        feedback = _Feedback(served, facts.duration_s)
        totals = self._cases.play(part, feedback.tell, served.on_cancel)
        feedback.flush()
        cancelled = served.cancelled.is_set()
        result = Replay.Result(
            success=not cancelled,
            message=f"cancelled after {totals.frames} frames" if cancelled else "",
            frames=totals.frames,
            breaches=totals.breaches,
            min_signed_distance=_metres(totals.min_signed_distance_mm),
        )
        return result, Ending.CANCELLED if cancelled else Ending.SUCCEEDED


class _Feedback:
    """Progress as messages, no more of them than anyone can follow, the last one always."""

    def __init__(self, served: ServedGoal, duration_s: float) -> None:
        self._served = served
        self._duration_s = duration_s
        self._next_s = -math.inf
        self._held: ReplayProgress | None = None

    def tell(self, progress: ReplayProgress) -> None:
        self._held = progress
        now_s = time.monotonic()
        if now_s >= self._next_s:
            self._next_s = now_s + 1.0 / FEEDBACK_HZ
            self.flush()

    def flush(self) -> None:
        if self._held is None:
            return
        self._served.feedback(
            Replay.Feedback(
                time=self._held.time_s,
                duration=self._duration_s,
                frames=self._held.frames,
                state=int(self._held.state),
                signed_distance=_metres(self._held.signed_distance_mm),
            )
        )
        self._held = None


def _part(goal: Replay.Goal) -> ReplayPart:
    if not (math.isfinite(goal.start) and goal.start >= 0.0):
        raise InputError(f"start of a replay is {goal.start} s: 0 or more wanted")
    if not goal.end > goal.start:
        raise InputError(
            f"end of a replay is {goal.end} s: after its start, {goal.start} s, wanted"
        )
    rate = None if goal.rate == math.inf else goal.rate
    return ReplayPart(goal.case_folder, rate, goal.start, goal.end)


def _metres(distance_mm: float | None) -> float:
    return math.nan if distance_mm is None else distance_mm / MM_PER_M
