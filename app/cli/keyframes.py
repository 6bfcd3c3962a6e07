"""Selects the steps of a replay that its movie shows, without knowing the replay's length."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
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
