"""Plays frames at the pace at which they were acquired, or faster, slower, step by step.

Time comes in from outside: ``clock_ns`` reads a clock, ``wait`` waits on an event. With them
replaced by a simulated pair a replay is deterministic and takes no time at all.
"""

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum, auto

from app.case.frames.samples import TrackingFrame
from app.geometry import NS_PER_S, InputError

Source = Callable[[], Iterator[TrackingFrame]]
Wait = Callable[[threading.Event, float | None], object]


def wait_on_event(event: threading.Event, timeout_s: float | None) -> None:
    """Wait for ``event``, at most ``timeout_s`` seconds; for ever when that is None."""
    event.wait(timeout_s)


class _Verdict(Enum):
    PLAY = auto()
    RESTART = auto()
    STOP = auto()


@dataclass(frozen=True, slots=True)
class _Anchor:
    """A moment of the recording, and what the clock read when it was played."""

    clock_ns: int
    media_ns: int


class Player:
    """Yields the frames of ``source`` when they are due; controlled from any thread.

    ``source`` opens the recording anew at each call; `seek` and loops do so. ``rate`` is recorded
    time over clock time; None plays without waiting. Every frame is yielded whatever the rate,
    late rather than dropped, and no frame is ever changed.
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
        """Whether frames are held back until `resume` or `step`."""
        return self._paused

    @property
    def time_ns(self) -> int | None:
        """The stamp of the frame that was played last, for ``/clock``; None before the first."""
        return self._last_ns

    def pause(self) -> None:
        """Hold the next frame back."""
        with self._lock:
            if not self._paused:
                self._anchor = self._anchor_now()
                self._paused = True
            self._changed.set()

    def resume(self) -> None:
        """Go on at the same rate from where the replay stands."""
        with self._lock:
            if self._paused and self._anchor is not None:
                self._anchor = _Anchor(self._clock_ns(), self._anchor.media_ns)
            self._paused, self._steps = False, 0
            self._changed.set()

    def step(self, frames: int = 1) -> None:
        """Pause, and let ``frames`` more frames pass at once."""
        if frames < 1:
            raise InputError(f"{frames} steps asked for: 1 or more wanted")
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
        """Go on with the first frame that is ``seconds`` or more after the recording's first.

        A paused replay shows that one frame and stays paused.
        """
        if not 0.0 <= seconds <= 1e9:
            raise InputError(f"seek to {seconds} s: 0 to 1e9 s wanted")
        with self._lock:
            self._seek_ns = round(seconds * NS_PER_S)
            self._steps = 1 if self._paused else 0
            self._changed.set()

    def stop(self) -> None:
        """End the replay at once, also while it waits."""
        with self._lock:
            self._stopped = True
            self._changed.set()

    def play(self) -> Iterator[TrackingFrame]:
        """Yield the frames, each when it is due; ends with the recording or with `stop`."""
        verdict = _Verdict.RESTART
        while verdict is _Verdict.RESTART:
            with self._lock:
                skip_ns, self._seek_ns = self._seek_ns, None
                self._anchor = None
            first_ns: int | None = None
            for frame in self._source():
                if first_ns is None:
                    first_ns = frame.stamp.ns
                early = skip_ns is not None and frame.stamp.ns - first_ns < skip_ns
                if early and not self._stopped:
                    continue
                skip_ns = None
                verdict = self._hold(frame.stamp.ns)
                if verdict is not _Verdict.PLAY:
                    break
                yield frame
            else:
                verdict = self._at_end(empty=first_ns is None)

    def _hold(self, media_ns: int) -> _Verdict:
        """Wait until the frame of ``media_ns`` is due, or a control says otherwise."""
        while True:
            with self._lock:
                self._changed.clear()
                if self._stopped:
                    return _Verdict.STOP
                if self._seek_ns is not None:
                    return _Verdict.RESTART
                timeout_s: float | None = None
                if self._paused and self._steps:
                    self._steps -= 1
                    self._anchor = _Anchor(self._clock_ns(), media_ns)
                    self._last_ns = media_ns
                    return _Verdict.PLAY
                if not self._paused:
                    remaining_ns = self._remaining_ns(media_ns)
                    if remaining_ns <= 0.0:
                        self._last_ns = media_ns
                        return _Verdict.PLAY
                    timeout_s = remaining_ns / NS_PER_S
            self._wait(self._changed, timeout_s)

    def _remaining_ns(self, media_ns: int) -> float:
        """Clock time until ``media_ns`` is due; a clock that jumped back counts from anew."""
        if self._rate is None:
            return 0.0
        jumped_back = self._last_ns is not None and media_ns < self._last_ns
        if self._anchor is None or jumped_back:
            self._anchor = _Anchor(self._clock_ns(), media_ns)
            self._last_ns = media_ns
        elapsed_ns = self._clock_ns() - self._anchor.clock_ns
        return (media_ns - self._anchor.media_ns) / self._rate - elapsed_ns

    def _anchor_now(self) -> _Anchor | None:
        """Where in the recording the replay stands at this moment."""
        if self._anchor is None:
            return None
        now_ns = self._clock_ns()
        if self._rate is None:
            played_ns = (self._last_ns or self._anchor.media_ns) - self._anchor.media_ns
        else:
            played_ns = round((now_ns - self._anchor.clock_ns) * self._rate)
        return _Anchor(now_ns, self._anchor.media_ns + played_ns)

    def _at_end(self, *, empty: bool) -> _Verdict:
        with self._lock:
            if self._stopped:
                return _Verdict.STOP
            wanted = self._loop and not empty
            return _Verdict.RESTART if wanted or self._seek_ns is not None else _Verdict.STOP


def checked_rate(rate: float | None) -> float | None:
    """``rate``, which None means to play without waiting; `InputError` for one that cannot be."""
    if rate is not None and not 0.001 <= rate <= 1000.0:
        raise InputError(f"rate {rate} of a replay: 0.001 to 1000 wanted")
    return rate
