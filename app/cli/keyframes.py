"""The steps of a replay that its movie shows, chosen while nobody knows how long it will be."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.session import StepResult


_FINER = 8
"""More steps than pictures are kept, so that in the end there are as many as there may be."""


class Reel:
    """Chooses at most ``most`` (1 or more) of the steps, evenly, and never misses a state.

    Of each interval of about equally many steps the first is taken, or the first of the worst
    state in it. Memory is bounded: where there are many, steps are merged in pairs.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._length = 1
        self._count = 0
        self._kept: list[StepResult] = []

    def add(self, step: "StepResult") -> None:
        """Take the next step."""
        place = self._count // self._length
        self._count += 1
        if place < len(self._kept):
            self._kept[place] = _worst([self._kept[place], step])
            return
        self._kept.append(step)
        if len(self._kept) > 2 * _FINER * self._most:
            self._length *= 2
            self._kept = _merged(self._kept, range(0, len(self._kept), 2))

    def steps(self) -> list["StepResult"]:
        """What was chosen, in order."""
        if len(self._kept) <= self._most:
            return list(self._kept)
        count = len(self._kept)
        return _merged(self._kept, [place * count // self._most for place in range(self._most)])


def _merged(steps: list["StepResult"], starts: Sequence[int]) -> list["StepResult"]:
    """One for each of the intervals that begin at ``starts``."""
    return [_worst(steps[a:b]) for a, b in zip(starts, [*starts[1:], len(steps)], strict=True)]


def _worst(steps: list["StepResult"]) -> "StepResult":
    return max(steps, key=lambda step: step.decision.state)  # the first of equals
