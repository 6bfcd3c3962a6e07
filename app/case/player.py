"""Plays frames or samples at the rate at which they were acquired, or faster, slower, step by step.

The clock is passed in: ``clock_ns`` reads it, ``wait`` waits on an event. With a simulated pair a
replay is deterministic and takes no time.
"""

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import Enum, auto

from app.case.frame_streams import JointSample, TrackingFrame
from app.geometry import NS_PER_S, InputError, Stamp, TrackedTransform

Source = Callable[[], Iterator[TrackingFrame]]
Wait = Callable[[threading.Event, float | None], object]


def wait_on_event(event: threading.Event, timeout_s: float | None) -> None:
    """Wait for ``event`` for ``timeout_s`` seconds at most; without limit when that is None."""
    event.wait(timeout_s)


class _Action(Enum):
    PLAY = auto()
    RESTART = auto()
    STOP = auto()


@dataclass(frozen=True, slots=True)
class _Anchor:
    """A time of the recording, and the time of the clock at which it was played."""

    clock_ns: int
    media_ns: int


class Player:
    """Yields the frames of ``source`` when they are due. Controls may be called from any thread.

    ``source`` opens the recording anew at each call; `seek` and loops do so. ``rate`` is recorded
    time over clock time; None plays without waiting. Every frame is yielded unchanged at any rate,
    late rather than dropped.
    """

    def __init__(
        self,
        source: Source,
        *,
        clock_ns: Callable[[], int],
        wait: Wait = wait_on_event,
        rate: float | None = 1.0,
        loop: bool = False,
    ) -> None:
        self._source = source
        self._clock_ns = clock_ns
        self._wait = wait
        self._rate = checked_rate(rate)
        self._loop = loop
        self._lock = threading.Lock()
        self._changed = threading.Event()
        self._paused = False
        self._stopped = False
        self._steps = 0
        self._seek_ns: int | None = None
        self._anchor: _Anchor | None = None
        self._last_ns: int | None = None

    @property
    def paused(self) -> bool:
        """True while frames are held back until `resume` or `step`."""
        return self._paused

    @property
    def time_ns(self) -> int | None:
        """Stamp of the last played frame, for ``/clock``; None before the first."""
        return self._last_ns

    def pause(self) -> None:
        """Hold back the next frame."""
        with self._lock:
            if not self._paused:
                self._anchor = self._anchor_now()
                self._paused = True
            self._changed.set()

    def resume(self) -> None:
        """Continue at the same rate from the current position."""
        with self._lock:
            if self._paused and self._anchor is not None:
                self._anchor = _Anchor(self._clock_ns(), self._anchor.media_ns)
            self._paused, self._steps = False, 0
            self._changed.set()

    def step(self, frames: int = 1) -> None:
        """Pause, and play ``frames`` more frames at once."""
        if frames < 1:
            raise InputError(f"number of steps is {frames}; expected 1 or more")
        self.pause()
        with self._lock:
            self._steps += frames
            self._changed.set()

    def set_rate(self, rate: float | None) -> None:
        """Change the rate from now on."""
        checked = checked_rate(rate)
        with self._lock:
            if not self._paused:
                self._anchor = self._anchor_now()
            self._rate = checked
            self._changed.set()

    def seek(self, seconds: float) -> None:
        """Continue with the first frame that is ``seconds`` or more after the recording's first.

        A paused replay plays that one frame and stays paused.
        """
        if not 0.0 <= seconds <= 1e9:
            raise InputError(f"time to seek is {seconds} s; expected 0 to 1e9 s")
        with self._lock:
            self._seek_ns = round(seconds * NS_PER_S)
            self._steps = 1 if self._paused else 0
            self._changed.set()

    def stop(self) -> None:
        """End the replay at once, also while it is waiting."""
        with self._lock:
            self._stopped = True
            self._changed.set()

    def play(self) -> Iterator[TrackingFrame]:
        """Yield each frame when it is due, until the end of the recording or `stop`."""
        action = _Action.RESTART
        while action is _Action.RESTART:
            with self._lock:
                skip_ns, self._seek_ns = self._seek_ns, None
                self._anchor = None
            first_ns: int | None = None
            for frame in self._source():
                if first_ns is None:
                    first_ns = frame.stamp.ns
                is_early = skip_ns is not None and frame.stamp.ns - first_ns < skip_ns
                if is_early and not self._stopped:
                    continue
                skip_ns = None
                action = self._hold(frame.stamp.ns)
                if action is not _Action.PLAY:
                    break
                yield frame
            else:
                action = self._at_end(empty=first_ns is None)

    def _hold(self, media_ns: int) -> _Action:
        """Wait until the frame of ``media_ns`` is due or a control is called."""
        while True:
            with self._lock:
                self._changed.clear()
                if self._stopped:
                    return _Action.STOP
                if self._seek_ns is not None:
                    return _Action.RESTART
                timeout_s: float | None = None
                if self._paused and self._steps:
                    self._steps -= 1
                    self._anchor = _Anchor(self._clock_ns(), media_ns)
                    self._last_ns = media_ns
                    return _Action.PLAY
                if not self._paused:
                    remaining_ns = self._remaining_ns(media_ns)
                    if remaining_ns <= 0.0:
                        self._last_ns = media_ns
                        return _Action.PLAY
                    timeout_s = remaining_ns / NS_PER_S
            self._wait(self._changed, timeout_s)

    def _remaining_ns(self, media_ns: int) -> float:
        """Clock time in ns until ``media_ns`` is due; starts anew where stamps jump back."""
        if self._rate is None:
            return 0.0
        jumped_back = self._last_ns is not None and media_ns < self._last_ns
        if self._anchor is None or jumped_back:
            self._anchor = _Anchor(self._clock_ns(), media_ns)
            self._last_ns = media_ns
        elapsed_ns = self._clock_ns() - self._anchor.clock_ns
        return (media_ns - self._anchor.media_ns) / self._rate - elapsed_ns

    def _anchor_now(self) -> _Anchor | None:
        """The current position in the recording."""
        if self._anchor is None:
            return None
        now_ns = self._clock_ns()
        if self._rate is None:
            played_ns = (self._last_ns or self._anchor.media_ns) - self._anchor.media_ns
        else:
            played_ns = round((now_ns - self._anchor.clock_ns) * self._rate)
        return _Anchor(now_ns, self._anchor.media_ns + played_ns)

    def _at_end(self, *, empty: bool) -> _Action:
        with self._lock:
            if self._stopped:
                return _Action.STOP
            is_looping = self._loop and not empty
            return _Action.RESTART if is_looping or self._seek_ns is not None else _Action.STOP


def checked_rate(rate: float | None) -> float | None:
    """``rate``, checked; None plays without waiting. `InputError` for a rate out of range."""
    if rate is not None and not 0.001 <= rate <= 1000.0:
        raise InputError(f"rate of a replay is {rate}; expected 0.001 to 1000")
    return rate


# The clocks are passed in, as for the `Player`, which times the samples.


@dataclass(frozen=True, slots=True, eq=False)
class PlayedSamples:
    """Samples that are due. ``poses``: all of one acquisition stamp, on the host's clock.

    ``joints``: on the robot's clock, whose recorded offset from the tracker's is kept.
    """

    poses: tuple[TrackedTransform, ...] = ()
    joints: tuple[JointSample, ...] = ()


class Playback:
    """Yields the samples of ``source`` with the intervals between their stamps as recorded.

    ``source`` yields the recording's own frames, with joints on the tracker's clock, from which
    ``offset_robot_to_tracker_ns`` is subtracted again. ``clock_ns`` is a steady clock, ``host_ns``
    the clock of the moved stamps. At ``rate`` 2 intervals are half as long as recorded. The
    recording starts ``start_s`` after its first sample.

    With ``loop`` it starts again ``pause_ns`` after its last sample, so that stamps increase across
    the seam. During the pause nothing is yielded: a pause longer than the limit for stale poses
    shows a session that the poses before and after it do not follow from each other.

    A recorded clock that jumps back does so here too. Raises `InputError` for a rate or a start
    that is out of range; `play` raises it for a recording that ends before ``start_s``.
    """

    def __init__(
        self,
        source: Source,
        *,
        offset_robot_to_tracker_ns: int,
        clock_ns: Callable[[], int],
        host_ns: Callable[[], int],
        rate: float = 1.0,
        loop: bool = False,
        start_s: float = 0.0,
        pause_ns: int = NS_PER_S,
        wait: Wait = wait_on_event,
    ) -> None:
        if not 0.0 <= start_s <= 1e9:
            raise InputError(f"start of a playback is {start_s} s; expected 0 to 1e9 s")
        self._source = source
        self._offset_ns = offset_robot_to_tracker_ns
        self._host_ns = host_ns
        checked_rate(rate)
        self._rate = rate
        self._loop = loop
        self._start_ns = round(start_s * NS_PER_S)
        self._pause_ns = round(pause_ns * rate)
        self._player = Player(self._passes, clock_ns=clock_ns, rate=rate, wait=wait)
        self._origin_ns: int | None = None
        """Stamp of the first sample of the first pass, which is played at ``_began_ns``."""
        self._began_ns = 0
        self._shift_ns = 0

    def play(self) -> Iterator[PlayedSamples]:
        """Yield the samples when they are due, until the recording ends or `stop`."""
        for frame in self._player.play():
            yield PlayedSamples(
                tuple(_moved(sample, self._moved_ns(sample.stamp.ns)) for sample in frame.poses),
                tuple(self._moved_joints(sample) for sample in frame.joints),
            )

    def stop(self) -> None:
        """End `play` at once, also while it waits. Thread-safe."""
        self._player.stop()

    def _passes(self) -> Iterator[TrackingFrame]:
        """The recording, repeated with ``loop``; the frames' own stamps increase over all passes.

        The player takes the next frame only after the one before has been yielded, so `_shift_ns`
        is that of the yielded frame.
        """
        while True:
            first_ns = newest_ns = None
            for frame in single_samples(self._source()):
                ns = frame.stamp.ns
                first_ns = ns if first_ns is None else first_ns
                if ns - first_ns < self._start_ns:
                    continue
                if self._origin_ns is None:
                    # Read before the player starts its time: no stamp is in the future.
                    self._origin_ns, self._began_ns = ns, self._host_ns()
                newest_ns = ns if newest_ns is None else max(newest_ns, ns)
                yield replace(frame, stamp=Stamp(ns + self._shift_ns, frame.stamp.clock))
            if newest_ns is None or self._origin_ns is None:
                raise InputError(
                    f"start of a playback is {self._start_ns / NS_PER_S:g} s; "
                    "expected a time before the end of the recording"
                )
            if not self._loop:
                return
            self._shift_ns += newest_ns - self._origin_ns + self._pause_ns

    def _moved_ns(self, ns: int) -> int:
        """Time on the host's clock at which a sample stamped ``ns`` in this pass is due."""
        played_ns = ns + self._shift_ns - (self._origin_ns or 0)
        return self._began_ns + round(played_ns / self._rate)

    def _moved_joints(self, sample: JointSample) -> JointSample:
        stamp = Stamp(self._moved_ns(sample.stamp.ns) - self._offset_ns, sample.stamp.clock)
        return JointSample.unchecked(sample.names, sample.positions, stamp)


def single_samples(frames: Iterator[TrackingFrame]) -> Iterator[TrackingFrame]:
    """Yield each joint sample and each group of poses of ``frames`` as a frame, ordered by stamp.

    A driver sends each sample when it is measured; a frame holds the joints since the last one. A
    joint sample that is older than the frame before it was late and is yielded at once.
    """
    newest_ns: int | None = None
    for frame in frames:
        poses = [TrackingFrame(frame.stamp, frame.poses)] if frame.poses else []
        for each in sorted(
            [*(TrackingFrame(sample.stamp, (), (sample,)) for sample in frame.joints), *poses],
            key=lambda item: item.stamp.ns,
        ):
            if each.joints and newest_ns is not None and each.stamp.ns < newest_ns:
                yield TrackingFrame(Stamp(newest_ns, each.stamp.clock), (), each.joints)
                continue
            newest_ns = each.stamp.ns
            yield each


def _moved(sample: TrackedTransform, ns: int) -> TrackedTransform:
    """``sample`` stamped ``ns``, with its status."""
    stamp = Stamp(ns, sample.stamp.clock)
    if sample.transform is not None:
        return TrackedTransform.valid(sample.transform, stamp)
    return TrackedTransform.lost(sample.target, sample.source, stamp, sample.status)
