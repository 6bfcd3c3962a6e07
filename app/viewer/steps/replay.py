"""Where a replay stands: played, paused, stepped, sought. Pure: its clock is handed in."""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

from app.viewer.errors import ViewerError

RATES = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Recorded time over clock time, as a page offers them."""


@dataclass(frozen=True, slots=True)
class _Anchor:
    """A moment of the recording, and what the clock read when it was played."""

    clock_ns: int
    media_ns: int


class ReplayControl:
    """Which of the frames is to be seen now. It ends, paused, at the last one.

    ``stamps_ns``: those of the frames, one or more; a stamp that jumps back counts for no time.
    """

    def __init__(self, stamps_ns: Sequence[int], clock_ns: Callable[[], int]) -> None:
        if not stamps_ns:
            raise ViewerError("the recording has 0 frames: 1 or more wanted to look at")
        steps = (max(after - before, 0) for before, after in pairwise(stamps_ns))
        self._media_ns = tuple(accumulate(steps, initial=0))
        self._clock_ns = clock_ns
        self._rate = 1.0
        self._frame = 0
        self._anchor: _Anchor | None = None

    @property
    def frames(self) -> int:
        """How many there are."""
        return len(self._media_ns)

    @property
    def duration_ns(self) -> int:
        """From the first frame to the last, of the time that only goes on."""
        return self._media_ns[-1]

    @property
    def rate(self) -> float:
        """Recorded time over clock time."""
        return self._rate

    @property
    def playing(self) -> bool:
        """Whether time goes on; not any more at the last frame."""
        self._follow()
        return self._anchor is not None

    @property
    def frame(self) -> int:
        """The frame that is to be seen now."""
        self._follow()
        return self._frame

    def time_ns(self, frame: int) -> int:
        """When ``frame`` is due, from the first one."""
        return self._media_ns[frame]

    def play(self) -> None:
        """Go on from here; at the end, from the beginning."""
        if self.frame == self.frames - 1:
            self._frame = 0
        self._anchor = _Anchor(self._clock_ns(), self._media_ns[self._frame])

    def pause(self) -> None:
        """Stay at the frame that is to be seen now."""
        self._follow()
        self._anchor = None

    def set_rate(self, rate: float) -> None:
        """Play at one of `RATES` from now on."""
        if rate not in RATES:
            raise ViewerError(f"rate {rate} of the replay: one of {RATES} wanted")
        self._follow()
        if self._anchor is not None:
            self._anchor = _Anchor(self._clock_ns(), self._now_ns(self._anchor))
        self._rate = rate

    def step(self, frames: int) -> None:
        """Pause, and go ``frames`` on, or back where negative; not beyond either end."""
        self.pause()
        self._frame = min(max(self._frame + frames, 0), self.frames - 1)

    def seek(self, share: float) -> None:
        """Go to the frame at ``share`` (0 to 1) of the duration; a replay that plays goes on."""
        if not 0.0 <= share <= 1.0:
            raise ViewerError(f"seek to {share} of the recording: 0 to 1 wanted")
        self._follow()
        self._frame = bisect_right(self._media_ns, round(share * self.duration_ns)) - 1
        if self._anchor is not None:
            self._anchor = _Anchor(self._clock_ns(), self._media_ns[self._frame])

    def _follow(self) -> None:
        """Move on to where the clock is."""
        if self._anchor is None:
            return
        now_ns = self._now_ns(self._anchor)
        self._frame = max(bisect_right(self._media_ns, now_ns) - 1, 0)
        if now_ns >= self.duration_ns:
            self._anchor = None

    def _now_ns(self, anchor: _Anchor) -> int:
        return anchor.media_ns + round((self._clock_ns() - anchor.clock_ns) * self._rate)
