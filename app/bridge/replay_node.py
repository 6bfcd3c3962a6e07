"""Replays on the ROS graph: the node, the services of its player, replays on request of others."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple, Protocol

from marginguard_msgs.action import Replay
from marginguard_msgs.srv import LoadCase, Seek, SetRate

from app.bridge.calls.action_server import ActionServer, GoalOutcome, ServedGoal
from app.bridge.calls.service_server import ServiceServer, trigger_server
from app.bridge.environment import domain_of
from app.bridge.messages import MM_PER_M, playback_text
from app.bridge.node import RosNode
from app.bridge.publishing.session_publisher import SessionPublisher
from app.files.paths import state_folder
from app.fixture import MarginState
from app.geometry import InputError, MarginGuardError
from app.hold import InstanceKey, host_id, refuse_beside_guard

if TYPE_CHECKING:
    from app.case import Player
    from app.runtime import PreparedCase, ReplayRun  # slow to load: with the compiled kernels

HEARTBEAT_HZ = 100.0
"""Rate at which the constraint is repeated while a replay follows real time."""

MAX_FEEDBACK_HZ = 20.0
"""Limits the feedback of replays faster than real time, which reach thousands of frames/s."""


class PlayerServices:
    """Serves the controls of ``player`` on ``ros`` until the node is closed.

    =============== =========================== ==================================
    ``~/play``      std_srvs/Trigger            resume at the same rate
    ``~/pause``     std_srvs/Trigger            pause
    ``~/step``      std_srvs/Trigger            pause and play one frame
    ``~/seek``      marginguard_msgs/Seek       jump to a time in seconds from the first frame
    ``~/set_rate``  marginguard_msgs/SetRate    recording seconds per second; inf: do not wait
    =============== =========================== ==================================

    If the player refuses a request, the response has ``success: false`` and the reason, and nothing
    changes.
    """

    def __init__(self, ros: RosNode, player: "Player") -> None:
        self._player = player
        for name, action in (
            ("play", player.resume),
            ("pause", player.pause),
            ("step", player.step),
        ):
            trigger_server(ros, f"~/{name}", action)
        ServiceServer(ros, Seek, "~/seek", self._seek)
        ServiceServer(ros, SetRate, "~/set_rate", self._set_rate)

    def _seek(self, request: Seek.Request, response: Seek.Response) -> None:
        try:
            self._player.seek(request.time)
        except MarginGuardError as error:
            response.message, response.time = str(error), math.nan
        else:
            response.success, response.time = True, request.time

    def _set_rate(self, request: SetRate.Request, response: SetRate.Response) -> None:
        self._player.set_rate(_rate(request.rate))
        response.success = True


@contextmanager
def replay_node(run: "ReplayRun", *, real_time: bool) -> Iterator[RosNode]:
    """Publish the steps of ``run`` over ROS and let other nodes control its player.

    ``real_time``: the replay follows a clock, so the constraint is repeated between its steps. The
    recorded poses are announced on `app.bridge.topics.PLAYBACK` before the first one.

    Raises `SecondInstanceError` beside a guard, whose topics a replay would publish, too.
    """
    refuse_beside_guard(state_folder(), InstanceKey(host_id(), domain_of(), "/", ""))
    heartbeat_hz = HEARTBEAT_HZ if real_time else None
    with SessionPublisher(
        run.commands.content,
        heartbeat_hz=heartbeat_hz,
        playback=playback_text(run.prepared.case.manifest),
    ) as publisher:
        PlayerServices(publisher.ros, run.player)
        run.outputs.append(publisher)
        try:
            yield publisher.ros
        finally:
            run.outputs.remove(publisher)


class ReplayProgress(NamedTuple):
    """Progress of a replay; ``signed_distance_mm`` is None while it is unknown."""

    time_s: float
    frames: int
    state: MarginState
    signed_distance_mm: float | None


class ReplayTotals(NamedTuple):
    """Totals of a replay that has finished or was stopped."""

    frames: int
    breaches: int
    min_signed_distance_mm: float | None


class Cases(Protocol):
    """Loads and plays cases in the calling thread. Implemented by the ``serve`` command."""

    def load(self, folder: str) -> "PreparedCase":
        """Load a case; an empty ``folder`` means the loaded one. Raises `MarginGuardError`."""

    def play(
        self,
        opened: "PreparedCase",
        *,
        rate: float | None,
        start_s: float,
        end_s: float,
        on_progress: Callable[[ReplayProgress], None],
        on_cancel: Callable[[Callable[[], None]], None],
    ) -> ReplayTotals:
        """Play a part of ``opened`` and call ``on_progress`` at every frame.

        ``rate`` None means as fast as possible; ``end_s`` may be inf. ``on_cancel(stop)`` registers
        the function that stops the replay at once.
        """


class ReplayServer:
    """Serves ``~/replay`` and ``~/load_case`` on ``ros`` until the node is closed.

    Runs one replay at a time.
    """

    def __init__(self, ros: RosNode, cases: Cases) -> None:
        self._cases = cases
        self._action = ActionServer(ros, Replay, "~/replay", self._run)
        self._load = ServiceServer(ros, LoadCase, "~/load_case", self._load_case, in_thread=True)

    def _load_case(self, request: LoadCase.Request, response: LoadCase.Response) -> None:
        if not request.case_folder:
            raise InputError("case_folder is empty; expected the folder of a case")
        opened = self._cases.load(request.case_folder)
        response.success = True
        response.name = opened.content.name
        response.frames = opened.extent.frames
        response.duration = opened.extent.duration_s

    def _run(self, served: ServedGoal) -> tuple[Replay.Result, GoalOutcome]:
        goal: Replay.Goal = served.request
        if not (math.isfinite(goal.start) and goal.start >= 0.0):
            raise InputError(f"start is {goal.start} s; expected 0 or more")
        if not goal.end > goal.start:
            raise InputError(f"end is {goal.end} s; expected more than the start, {goal.start} s")
        opened = self._cases.load(goal.case_folder)
        duration_s = opened.extent.duration_s
        if not goal.start <= duration_s:
            raise InputError(
                f"start is {goal.start:g} s; expected at most {duration_s:g} s, "
                "the duration of the recording"
            )
        feedback = _Feedback(served, duration_s)
        totals = self._cases.play(
            opened,
            rate=_rate(goal.rate),
            start_s=goal.start,
            end_s=goal.end,
            on_progress=feedback.update,
            on_cancel=served.on_cancel,
        )
        feedback.flush()
        cancelled = served.cancelled.is_set()
        result = Replay.Result(
            success=not cancelled,
            message=f"cancelled after {totals.frames} frames" if cancelled else "",
            frames=totals.frames,
            breaches=totals.breaches,
            min_signed_distance=_metres(totals.min_signed_distance_mm),
        )
        return result, GoalOutcome.CANCELLED if cancelled else GoalOutcome.SUCCEEDED


class _Feedback:
    """Publishes progress at `MAX_FEEDBACK_HZ` at most; `flush` publishes the latest one."""

    def __init__(self, served: ServedGoal, duration_s: float) -> None:
        self._served = served
        self._duration_s = duration_s
        self._next_s = -math.inf
        self._progress: ReplayProgress | None = None

    def update(self, progress: ReplayProgress) -> None:
        self._progress = progress
        now_s = time.monotonic()
        if now_s >= self._next_s:
            self._next_s = now_s + 1.0 / MAX_FEEDBACK_HZ
            self.flush()

    def flush(self) -> None:
        if self._progress is None:
            return
        self._served.feedback(
            Replay.Feedback(
                time=self._progress.time_s,
                duration=self._duration_s,
                frames=self._progress.frames,
                state=int(self._progress.state),
                signed_distance=_metres(self._progress.signed_distance_mm),
            )
        )
        self._progress = None


def _rate(rate: float) -> float | None:
    """The rate of a player: None, which waits for nothing, for inf."""
    return None if rate == math.inf else rate


def _metres(distance_mm: float | None) -> float:
    return math.nan if distance_mm is None else distance_mm / MM_PER_M
