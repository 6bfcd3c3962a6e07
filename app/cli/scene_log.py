"""Keeps what the scene file and the movie of a replay need, while it runs."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from app.geometry import NS_PER_S
from app.runtime import PassiveOutput

if TYPE_CHECKING:
    from app.fixture import MarginState, Reason
    from app.geometry import TrackedTransform
    from app.runtime import StepTiming
    from app.session import StepResult


PICTURES_PER_S = 12.5
"""Pictures of a movie in a second of it."""

_OVERSAMPLING = 8
"""Ratio of kept to selected steps, so that the selection is even in the end."""


class KeyframeSelector:
    """Selects at most ``max_count`` (1 or more) steps, evenly, and misses no state.

    The steps are divided into intervals of about the same number of steps. Of each interval the
    first step of its worst state is selected. Memory is bounded: when too many steps are kept,
    neighbouring intervals are merged.
    """

    def __init__(self, max_count: int) -> None:
        self._max_count = max_count
        self._interval = 1
        self._count = 0
        self._kept: list[StepResult] = []

    def add(self, step: "StepResult") -> None:
        """Take the next step."""
        index = self._count // self._interval
        self._count += 1
        if index < len(self._kept):
            self._kept[index] = _worst([self._kept[index], step])
            return
        self._kept.append(step)
        if len(self._kept) > 2 * _OVERSAMPLING * self._max_count:
            self._interval *= 2
            self._kept = _merged(self._kept, range(0, len(self._kept), 2))

    def steps(self) -> list["StepResult"]:
        """The selected steps, in order."""
        count, max_count = len(self._kept), self._max_count
        if count <= max_count:
            return list(self._kept)
        return _merged(self._kept, [index * count // max_count for index in range(max_count)])


def _merged(steps: list["StepResult"], starts: Sequence[int]) -> list["StepResult"]:
    """The worst step of each interval; intervals begin at ``starts``."""
    return [_worst(steps[a:b]) for a, b in zip(starts, [*starts[1:], len(steps)], strict=True)]


def _worst(steps: list["StepResult"]) -> "StepResult":
    return max(steps, key=lambda step: step.decision.state)  # the first of equal states


class SceneLog(PassiveOutput):
    """`Output` that keeps of every step what the scene file and the movie need."""

    def __init__(self, *, recording: bool, max_keyframes: int | None) -> None:
        """``max_keyframes``: the maximum number of pictures of the movie; None for no movie."""
        self._keeps_recording = recording
        self.frames: list[tuple[TrackedTransform, ...]] = []
        """The samples of each acquisition."""
        self.states: list[tuple[int, MarginState, tuple[Reason, ...]]] = []
        """The stamp in ns, the state and its reasons, of each step."""
        self._selector = None if max_keyframes is None else KeyframeSelector(max_keyframes)
        self.first_ns: int | None = None

    def publish(self, step: "StepResult", timing: "StepTiming") -> bool:
        """Keep what scene file and movie need of ``step``."""
        if self.first_ns is None:
            self.first_ns = step.frame.stamp.ns
        if self._keeps_recording:
            if step.frame.poses:
                self.frames.append(step.frame.poses)
            decision = step.decision
            self.states.append((step.frame.stamp.ns, decision.state, decision.reasons))
        if self._selector is not None:
            self._selector.add(step)
        return True

    def keyframes(self) -> list[tuple[float, "StepResult"]]:
        """The steps of the movie with their times in s from the first frame."""
        if self._selector is None or self.first_ns is None:
            return []
        return [
            ((step.frame.stamp.ns - self.first_ns) / NS_PER_S, step)
            for step in self._selector.steps()
        ]
