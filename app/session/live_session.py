"""Session of a live source: one step per frame, and one whenever a pose becomes stale."""

import threading
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from app.case import Activation, JointSample, TrackingFrame
from app.fixture import Reason
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    Edge,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    stale_in_ns,
)
from app.session.live_frames import LiveFrames, SourceClock
from app.session.session import NOTHING_OUTSIDE, Session
from app.session.step_result import StepResult


@dataclass(frozen=True, slots=True)
class PlaybackRule:
    """Whether a live session uses samples while a recording is played on its graph.

    ``found`` returns a description of the playback, empty if there is none. Without
    ``accepted`` every sample counts as `TrackingStatus.INVALID` while there is one, whatever its
    sender is: the state is UNKNOWN and then on hold, and no recorded pose enters the session.
    """

    found: Callable[[], str] = lambda: ""
    accepted: bool = False

    def refuses(self) -> bool:
        """True while samples must not enter the session. Thread-safe if ``found`` is."""
        return not self.accepted and bool(self.found())

    def checked(
        self, frame: TrackingFrame, playback: str, edges: Collection[tuple[str, str]] = ()
    ) -> TrackingFrame:
        """``frame``, or one without joints whose poses are all lost if ``playback`` is refused.

        ``edges`` (target, source) are lost as well then, whether ``frame`` has samples of them or
        not: the poses from before the playback must not remain in use.
        """
        if self.accepted or not playback:
            return frame
        lost = dict.fromkeys(edges, frame.stamp)
        lost |= {(each.target, each.source): each.stamp for each in frame.poses}
        poses = tuple(
            TrackedTransform.lost(*edge, stamp, TrackingStatus.INVALID)
            for edge, stamp in lost.items()
        )
        return replace(frame, poses=poses, joints=())

    def problem(self, playback: str) -> str:
        """The reason why no sample is used; empty if samples are used."""
        if self.accepted or not playback:
            return ""
        return f"PLAYBACK refused: {playback}; expected provenance.kind 'simulated' in live.yaml"


NO_PLAYBACK = PlaybackRule()
"""For a source that no recording can be played on."""


TICK_NS = 100 * NS_PER_MS
"""Period of the steps while the source is silent."""

GAP_NS = 2 * TICK_NS
"""Without a sign of life for longer, this process was stopped: it looks every `TICK_NS`."""

SETTLED_AFTER_NS = 100 * NS_PER_MS
"""After a gap, samples that arrive within this time may have waited in a buffer during it."""

_REFUSED = "samples during a refused playback"

Wait = Callable[[threading.Condition, float], object]
"""Waits on a held condition for at most a number of seconds."""


class LiveSession:
    """``for step in live.steps(): publish(step)``, while other threads `add` samples.

    Each frame is stepped as soon as it is ready. When the oldest pose of the last decision becomes
    stale, the session steps at once with a frame without poses, and again every `TICK_NS`: an old
    margin is never left standing. ``host_ns`` reads the host's clock, ``wait`` waits on it.
    ``playback`` decides whether samples are used while a recording is played on the graph.
    ``outside`` returns the faults that are present outside the samples (a second sender, say), with
    a text for each; it is called once before each step and must be quick.
    ``source_problem`` returns why the source cannot send, such as a server that is gone; empty if
    it can. ``activation`` returns that of the present, which frames carry for displays and
    records; None without such a source.
    """

    def __init__(
        self,
        session: Session,
        *,
        host_ns: Callable[[], int],
        stamps_of_host: bool,
        edges: Sequence[Edge] = (),
        playback: PlaybackRule = NO_PLAYBACK,
        outside: Callable[[], Mapping[Reason, str]] = lambda: NOTHING_OUTSIDE,
        wait: Wait = threading.Condition.wait,
        source_problem: Callable[[], str] = lambda: "",
        activation: Callable[[], Activation] | None = None,
    ) -> None:
        self._activation = activation
        self._source_problem = source_problem
        self._session = session
        self._host_ns = host_ns
        self._wait = wait
        self._clock = SourceClock(stamps_of_host=stamps_of_host)
        self._frames = LiveFrames(session.setup, self._clock, edges)
        self._playback = playback
        self._outside = outside
        self._changed = threading.Condition()
        self._stepping = threading.Lock()
        self._stopped = False
        self._refused = False
        self._watch_ns = self._taken_ns = self._alive_ns = host_ns()
        self._woke_ns: int | None = None

    @property
    def edges(self) -> tuple[Edge, ...]:
        """Edges (parent, child) known so far that connect the tumour to the tool."""
        with self._changed:
            return self._frames.edges

    def left_out(self) -> dict[str, int]:
        """Number of samples that were not used, by reason."""
        with self._changed:
            return dict(self._frames.left_out)

    def add(self, samples: Sequence[TrackedTransform]) -> None:
        """Add samples that have just arrived.

        During a refused playback they are dropped, so that no recorded stamp enters the estimate of
        the source's clock; the session steps without them. After a gap of this process they may
        have waited meanwhile: they are used by their stamps, but do not train the clock.
        """
        refused = self._playback.refuses()
        with self._changed:
            host_ns = self._host_ns()
            if refused:
                self._refused = True
                self._frames.left_out[_REFUSED] += len(samples)
            else:
                self._frames.add(samples, host_ns, train=not self._may_have_waited(host_ns))
            self._changed.notify()

    def add_joints(self, sample: JointSample, *, of_host: bool) -> None:
        """Add joints, stamped by the source's clock or, with ``of_host``, by the host's.

        Joints of the host are dropped until the source's time is known. Joints trigger no step,
        because the margin depends on the tracker.
        """
        with self._changed:
            offset_ns = self._clock.offset_ns(self._host_ns()) if of_host else 0
            if offset_ns is not None:
                stamp = sample.stamp.shifted(-offset_ns, sample.stamp.clock)
                self._frames.add_joints(JointSample(sample.names, sample.positions, stamp))

    def spent_ns(self) -> int:
        """Time in ns since the frame of the last step was taken; its data are older by it now."""
        return max(0, self._host_ns() - self._taken_ns)

    def hold(self, cause: str, *, doubt: bool = False) -> None:
        """Latch ``hold`` from the next step on. Call it while consuming a step of `steps`.

        ``cause`` is a text for the operator, ``doubt`` as in `Session.hold`.
        """
        self._session.hold(cause, doubt=doubt)

    @contextmanager
    def between_steps(self) -> Iterator[Session]:
        """The session, locked between two steps so that it can be changed.

        Waits until the consumer of `steps` has processed the current step.
        """
        with self._stepping:
            yield self._session
            with self._changed:
                self._frames.use(self._session.setup)

    def stop(self) -> None:
        """End `steps`, even while it waits. Thread-safe."""
        with self._changed:
            self._stopped = True
            self._changed.notify()

    def resume(self) -> None:
        """Undo `stop`, so that `steps` can be called again."""
        with self._changed:
            self._stopped = False

    def steps(self) -> Generator[StepResult]:
        """Yield the steps as they happen, until `stop`."""
        while self._is_due():
            with self._stepping:
                # Taken under the lock: a frame is stamped when it is taken.
                frame = self._take()
                if self._activation is not None:
                    frame = replace(frame, activation=self._activation())
                # Checked after the samples were taken: a playback is discovered before them.
                playback = self._playback.found()
                checked = self._playback.checked(frame, playback, self.edges)
                step = self._session.step(checked, self._faults(playback))
                step = self._with_source_problems(step, playback)
                self._watch_ns = self._next_watch_ns(step)
                yield step

    def _is_due(self) -> bool:
        """Wait for a ready frame or for the next watchdog step; False once stopped."""
        with self._changed:
            while not self._stopped:
                host_ns = self._host_ns()
                self._may_have_waited(host_ns)
                if self._refused:
                    return True
                remaining_ns = self._watch_ns - host_ns
                ready_ns = self._frames.ready_in_ns(host_ns)
                # A longer wait than possible means that the host's clock was set back.
                if ready_ns == 0 or not 0 < remaining_ns <= self._longest_wait_ns():
                    return True
                if ready_ns is not None:
                    remaining_ns = min(remaining_ns, ready_ns)
                self._wait(self._changed, min(remaining_ns, TICK_NS) / NS_PER_S)
        return False

    def _take(self) -> TrackingFrame:
        """The ready frame, or one without poses; stamped with the present."""
        with self._changed:
            host_ns = self._taken_ns = self._host_ns()
            self._refused = False
            frame = self._frames.take(host_ns)
            # Before the first sample the source's time is unknown; 0 is before all stamps.
            if frame is not None:
                return frame
            now = self._clock.now(host_ns)
            # Joints are known although the tracker is silent: only the tracker is at fault.
            return TrackingFrame(Stamp(0), ()) if now is None else self._frames.take_others(now)

    def _faults(self, playback: str) -> Mapping[Reason, str]:
        """Faults outside the frame; a refused playback makes poses invalid, also unknown ones."""
        problem, outside = self._playback.problem(playback), self._outside()
        return {Reason.INVALID: problem, **outside} if problem else outside

    def _may_have_waited(self, host_ns: int) -> bool:
        """True if a sample that arrives now may be older than its arrival suggests.

        To be called, with the lock, by every thread that looks at the host's clock: the first one
        after a gap of this process detects it.
        """
        if host_ns - self._alive_ns > GAP_NS:
            self._woke_ns = host_ns
        self._alive_ns = host_ns
        return self._woke_ns is not None and host_ns - self._woke_ns < SETTLED_AFTER_NS

    def _with_source_problems(self, step: StepResult, playback: str) -> StepResult:
        """``step`` with a playback, and with the problems of the source before its own."""
        with self._changed:
            missing = self._frames.missing_frames_problem(self._host_ns())
        refused = self._playback.problem(playback)
        if refused:
            missing = ""  # poses come, and are refused
        own = step.frames_problems or (refused,)
        problems = tuple(filter(None, [self._source_problem(), missing, *own]))
        if not problems and not playback:
            return step
        return replace(step, frames_problems=problems, playback=playback)

    def _next_watch_ns(self, step: StepResult) -> int:
        """Host time at which the oldest pose of ``step`` becomes stale; one tick ahead if it is."""
        host_ns = self._host_ns()
        oldest, now = step.decision.stamp, self._clock.now(host_ns)
        if oldest is not None and now is not None:
            limits = self._session.setup.margins.freshness_limits
            left_ns = stale_in_ns(oldest.ns, now.ns, limits) + 1
            if left_ns > 0:
                return host_ns + min(self._clock.host_time_for(left_ns), self._longest_wait_ns())
        return host_ns + TICK_NS

    def _longest_wait_ns(self) -> int:
        """Upper bound in ns of the time until a known pose is stale, whatever its stamp."""
        stale_after_ns = self._session.setup.margins.stale_after_ns
        return max(self._clock.host_time_for(stale_after_ns + 1), TICK_NS)
