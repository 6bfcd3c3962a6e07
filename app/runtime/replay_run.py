"""A recorded case played through a session, with its outputs."""

import math
import threading
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager

from app.case import Player
from app.geometry import NS_PER_S
from app.runtime.commands import OperatorCommands
from app.runtime.content import SessionContent
from app.runtime.opening import PreparedCase
from app.runtime.operator_command import LocalOperator
from app.runtime.outputs import Output, StepHolds, StepTiming, end_outputs
from app.session import Session, SessionSetup, SetupDoubts, StepResult

THE_REPLAY = "the replay"
"""Origin of changes that no display requests."""


class ReplayRun:
    """Plays ``prepared`` with a session of its own and publishes each step to ``outputs``.

    ``rate`` is recorded time over clock time; None plays as fast as possible. ``start_s`` seeks
    before the first frame and ``end_s`` ends the run, both in seconds from the recording's first
    frame; a seek later needs another run, because a session whose clock jumps latches a fault.
    ``setup`` and ``content`` replace those of ``prepared`` after an operator has changed them;
    ``origin`` is the display whose operator that is.
    ``clock_ns`` paces the player, ``stopwatch_ns`` measures each step. ``free_motion`` is that of
    `Session`.
    """

    def __init__(
        self,
        prepared: PreparedCase,
        *,
        clock_ns: Callable[[], int],
        stopwatch_ns: Callable[[], int] | None = None,
        rate: float | None = None,
        loop: bool = False,
        start_s: float = 0.0,
        end_s: float = math.inf,
        paused: bool = False,
        setup: SessionSetup | None = None,
        content: SessionContent | None = None,
        outputs: Sequence[Output] = (),
        free_motion: bool = False,
        origin: str = THE_REPLAY,
    ) -> None:
        self.prepared = prepared
        self.session = Session(setup or prepared.setup, free_motion=free_motion)
        self.player = Player(prepared.case.frames, clock_ns=clock_ns, rate=rate, loop=loop)
        if paused:
            self.player.pause()
        if paused or start_s != 0.0:
            self.player.seek(start_s)
        self._end_ns: float = math.inf
        if math.isfinite(end_s):
            self._end_ns = prepared.extent.first_ns + end_s * NS_PER_S
        self.holds = StepHolds()
        self.outputs = [self.holds, *outputs]
        self.robot_problems = RobotProblems()
        self.doubts = SetupDoubts(self.session.setup)
        self._stopwatch_ns = stopwatch_ns or clock_ns
        self._rate = rate
        self._stepping = threading.Lock()
        content = content or prepared.content
        self.commands = OperatorCommands(
            self.between_steps, content, self.outputs, holds=self.holds
        )
        self.operator = LocalOperator(self.commands, origin)

    def steps(self) -> Generator[StepResult]:
        """Publish and yield the step of each frame, when it is due; ends with `stop`.

        At the end, also after an error, every output has withdrawn what it permitted and has
        published its final state, as in a `LiveRun`.
        """
        try:
            for frame in self.player.play():
                if frame.stamp.ns > self._end_ns:
                    break
                with self._stepping:
                    began_ns = self._stopwatch_ns()
                    step = self.session.step(frame)
                    timing = StepTiming(duration_ns=self._stopwatch_ns() - began_ns)
                    self.robot_problems.add(step)
                    self.doubts.observe(step)
                    for output in self.outputs:
                        output.publish(step, timing)
                    yield step
        finally:
            with self._stepping:
                end_outputs(self.outputs)

    @property
    def delay_ns(self) -> int:
        """0: steps are taken here."""
        return 0

    def stop(self) -> None:
        """End `steps` soon; from any thread."""
        self.player.stop()

    @contextmanager
    def between_steps(self) -> Iterator[Session]:
        """Exclusive access to the session between two steps."""
        with self._stepping:
            yield self.session

    def set_rate(self, rate: float) -> None:
        """Change the rate from now on; raises `InputError` out of range."""
        self.player.set_rate(rate)
        self._rate = rate

    def pace(self) -> float:
        """Rate of recorded time over clock time, at most 1; 0 while the replay is paused."""
        if self.player.paused:
            return 0.0
        return 1.0 if self._rate is None else min(self._rate, 1.0)


class RobotProblems:
    """Counts the frames in which the robot could not be displayed, by kind of problem."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._first_of_kind: dict[str, str] = {}

    def add(self, step: StepResult) -> None:
        """Count the problem of ``step``, if it has one."""
        if step.robot_problem:
            # The detail behind the colon differs from frame to frame: keep the first one.
            kind = step.robot_problem.partition(":")[0]
            self._counts[self._first_of_kind.setdefault(kind, step.robot_problem)] += 1

    def items(self) -> Iterator[tuple[str, int]]:
        """The first message of each kind and the number of frames that had it."""
        yield from self._counts.items()
