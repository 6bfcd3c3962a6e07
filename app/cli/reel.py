"""The steps of a replay that its movie shows, chosen while nobody knows how long it will be."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.session import StepResult


class Reel:
    """Keeps at most ``most`` (2 or more) steps, one of every so many, and never misses a state.

    Of each interval of equally many steps the first is kept, or the first of the worst state in it.
    When there are too many, the intervals become twice as long.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._length = 1
        self._count = 0
        self.steps: list[StepResult] = []

    def add(self, step: "StepResult") -> None:
        """Take the next step."""
        place = self._count // self._length
        self._count += 1
        if place < len(self.steps):
            self.steps[place] = _worse(self.steps[place], step)
            return
        self.steps.append(step)
        if len(self.steps) > self._most:
            self._length *= 2
            pairs = zip(self.steps[::2], [*self.steps[1::2], None], strict=False)
            self.steps = [one if other is None else _worse(one, other) for one, other in pairs]


def _worse(one: "StepResult", other: "StepResult") -> "StepResult":
    return other if other.decision.state > one.decision.state else one
