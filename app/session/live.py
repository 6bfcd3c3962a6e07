"""A session that follows a live source: one step a frame, and one whenever a pose becomes stale."""

import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from app.case import JointSample, TrackingFrame
from app.geometry import NS_PER_MS, NS_PER_S, Stamp, TrackedTransform, stale_in_ns
from app.session.live_clock import SourceClock
from app.session.live_frames import LiveFrames
from app.session.pose_tree import Edge
from app.session.session import Session, StepResult

TICK_NS = 100 * NS_PER_MS
"""How often a session steps while its source is silent."""

Wait = Callable[[threading.Condition, float], object]
"""Waits on a condition that is held, at most so many seconds."""


class LiveSession:
    """``for step in live.steps(): publish(step)``, while other threads `add` what arrives.

    A frame is stepped as soon as it is ready, not at a rate. When the oldest pose that the last
    decision rests on becomes stale, a frame without poses follows at once, and others every
    `TICK_NS`: the margin is never better than what is known now. ``host_ns`` reads the host's
    clock, ``wait`` waits on it.
    """

    def __init__(
        self,
        session: Session,
        *,
        host_ns: Callable[[], int],
        stamps_of_host: bool,
        edges: Sequence[Edge] = (),
        wait: Wait = threading.Condition.wait,
    ) -> None:
        self._session = session
        self._host_ns = host_ns
        self._wait = wait
        self._clock = SourceClock(stamps_of_host=stamps_of_host)
        self._frames = LiveFrames(session.setup, self._clock, edges)
        self._changed = threading.Condition()
        self._stepping = threading.Lock()
        self._stopped = False
        self._watch_ns = self._taken_ns = host_ns()

    @property
    def edges(self) -> tuple[Edge, ...]:
        """The edges (parent, child) that lead from the tumour to the tool, as far as known."""
        with self._changed:
            return self._frames.edges

    def left_out(self) -> dict[str, int]:
        """How many samples were not used, by reason."""
        with self._changed:
            return dict(self._frames.left_out)

    def add(self, samples: Sequence[TrackedTransform]) -> None:
        """Take samples that have just arrived."""
        with self._changed:
            self._frames.add(samples, self._host_ns())
            self._changed.notify()

    def add_joints(self, sample: JointSample, *, of_host: bool) -> None:
        """Take joints, stamped by the source's clock or, ``of_host``, by the host's.

        Those of the host before the source's time is known are of no use. They make no step of
        their own: the margin is measured by the tracker.
        """
        with self._changed:
            offset_ns = self._clock.offset_ns(self._host_ns()) if of_host else 0
            if offset_ns is not None:
                stamp = sample.stamp.shifted(-offset_ns, sample.stamp.clock)
                self._frames.add_joints(JointSample(sample.names, sample.positions, stamp))

    def spent_ns(self) -> int:
        """How long ago the frame of the last step was taken: by so much its data are older now."""
        return max(0, self._host_ns() - self._taken_ns)

    def hold(self) -> None:
        """Latch ``hold`` from the next step on; for whoever takes `steps`, while it has one."""
        self._session.hold()

    @contextmanager
    def between_steps(self) -> Iterator[Session]:
        """The session itself, to be changed after a step was dealt with and before the next.

        Waits for a step that is being taken, and for what the caller of `steps` does with it.
        """
        with self._stepping:
            yield self._session

    def stop(self) -> None:
        """End `steps`, also while it waits."""
        with self._changed:
            self._stopped = True
            self._changed.notify()

    def resume(self) -> None:
        """Undo `stop`, so that `steps` can be asked for again."""
        with self._changed:
            self._stopped = False

    def steps(self) -> Generator[StepResult]:
        """Yield the steps as they happen, for ever; ends with `stop`."""
        while self._is_due():
            with self._stepping:
                # Only now: the lock may have been waited for, and a frame is stamped when taken.
                step = self._named(self._session.step(self._take()))
                self._watch_ns = self._next_watch_ns(step)
                yield step

    def _is_due(self) -> bool:
        """Wait for a frame that is ready or for the watch; False once stopped."""
        with self._changed:
            while not self._stopped:
                host_ns = self._host_ns()
                remaining_ns = self._watch_ns - host_ns
                ready_ns = self._frames.ready_in_ns(host_ns)
                # Too long a wait: the host's clock was set back.
                if ready_ns == 0 or not 0 < remaining_ns <= self._longest_wait_ns():
                    return True
                if ready_ns is not None:
                    remaining_ns = min(remaining_ns, ready_ns)
                self._wait(self._changed, min(remaining_ns, TICK_NS) / NS_PER_S)
        return False

    def _take(self) -> TrackingFrame:
        """What is ready, or a frame without poses; stamped with the present."""
        with self._changed:
            host_ns = self._taken_ns = self._host_ns()
            frame = self._frames.take(host_ns)
            # Without a sample the source's time is not known: it is before all others.
            return frame or TrackingFrame(self._clock.now(host_ns) or Stamp(0), ())

    def _named(self, step: StepResult) -> StepResult:
        """``step``, which tells what frames never came, where it has nothing worse to tell."""
        with self._changed:
            lacks = self._frames.not_sent(self._host_ns())
        return replace(step, frames_problem=lacks) if lacks and not step.frames_problem else step

    def _next_watch_ns(self, step: StepResult) -> int:
        """When the oldest pose of ``step`` will be stale, or a tick from now if it is already."""
        host_ns = self._host_ns()
        oldest, now = step.decision.stamp, self._clock.now(host_ns)
        if oldest is not None and now is not None:
            limits = self._session.setup.margins.freshness_limits
            left_ns = stale_in_ns(oldest.ns, now.ns, limits) + 1
            if left_ns > 0:
                return host_ns + min(self._clock.host_time_for(left_ns), self._longest_wait_ns())
        return host_ns + TICK_NS

    def _longest_wait_ns(self) -> int:
        """No pose that is known lasts longer, whatever its stamp says."""
        stale_after_ns = self._session.setup.margins.stale_after_ns
        return max(self._clock.host_time_for(stale_after_ns + 1), TICK_NS)
