"""Position of a replay: play, pause, step, seek. The clock is passed in."""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

from app.viewer.errors import ViewerError

RATES = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""The rates of the page: recorded time over clock time."""


@dataclass(frozen=True, slots=True)
class _Anchor:
    """A time of the recording and the clock's time at which it was played."""

    clock_ns: int
    media_ns: int


class ReplayControl:
    """Selects the frame to be shown now. It pauses at the last one.

    ``stamps_ns`` are the stamps of the frames, one or more; a jump back counts as 0 ns.
    """

    def __init__(self, stamps_ns: Sequence[int], clock_ns: Callable[[], int]) -> None:
        if not stamps_ns:
            raise ViewerError("recording: 0 frames; expected 1 or more")
        steps = (max(after - before, 0) for before, after in pairwise(stamps_ns))
        self._media_ns = tuple(accumulate(steps, initial=0))
        self._clock_ns = clock_ns
        self._rate = 1.0
        self._frame = 0
        self._anchor: _Anchor | None = None

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self._media_ns)

    @property
    def duration_ns(self) -> int:
        """Time from the first to the last frame, without jumps back of the clock."""
        return self._media_ns[-1]

    @property
    def rate(self) -> float:
        """Recorded time over clock time."""
        return self._rate

    @property
    def playing(self) -> bool:
        """True while the replay plays; False at the last frame."""
        self._follow()
        return self._anchor is not None

    @property
    def frame(self) -> int:
        """Index of the frame to be shown now."""
        self._follow()
        return self._frame

    def time_ns(self, frame: int) -> int:
        """Time of ``frame`` since the first one."""
        return self._media_ns[frame]

    def play(self) -> None:
        """Play from here; at the end, from the beginning."""
        if self.frame == self.frames - 1:
            self._frame = 0
        self._anchor = _Anchor(self._clock_ns(), self._media_ns[self._frame])

    def pause(self) -> None:
        """Stop at the current frame."""
        self._follow()
        self._anchor = None

    def set_rate(self, rate: float) -> None:
        """Play at one of `RATES` from now on."""
        if rate not in RATES:
            raise ViewerError(f"rate of the replay: {rate}; expected one of {RATES}")
        self._follow()
        if self._anchor is not None:
            self._anchor = _Anchor(self._clock_ns(), self._now_ns(self._anchor))
        self._rate = rate

    def step(self, frames: int) -> None:
        """Pause, and move by ``frames``, backward if negative, within the recording."""
        self.pause()
        self._frame = min(max(self._frame + frames, 0), self.frames - 1)

    def go_to(self, frame: int) -> None:
        """Pause at ``frame``."""
        if not 0 <= frame < self.frames:
            raise ViewerError(f"frame: {frame}; expected 0 to {self.frames - 1}")
        self.pause()
        self._frame = frame

    def seek(self, share: float) -> None:
        """Go to the frame at ``share`` (0 to 1) of the duration; a playing replay keeps playing."""
        if not 0.0 <= share <= 1.0:
            raise ViewerError(f"seek in the recording: {share}; expected 0 to 1")
        self._follow()
        self._frame = bisect_right(self._media_ns, round(share * self.duration_ns)) - 1
        if self._anchor is not None:
            self._anchor = _Anchor(self._clock_ns(), self._media_ns[self._frame])

    def _follow(self) -> None:
        """Advance to the clock's time."""
        if self._anchor is None:
            return
        now_ns = self._now_ns(self._anchor)
        self._frame = max(bisect_right(self._media_ns, now_ns) - 1, 0)
        if now_ns >= self.duration_ns:
            self._anchor = None

    def _now_ns(self, anchor: _Anchor) -> int:
        return anchor.media_ns + round((self._clock_ns() - anchor.clock_ns) * self._rate)
