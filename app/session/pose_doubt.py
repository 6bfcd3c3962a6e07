"""Planes of a pose that may be wrong are not current: a retreat from them may be an approach."""

from dataclasses import replace

from app.fixture import POSE_DOUBTS, FixtureDecision


class PoseDoubt:
    """Remembers one of `POSE_DOUBTS` for as long as the hold lasts that it began or prolonged."""

    def __init__(self) -> None:
        self._doubted = False

    def begin(self) -> None:
        """Doubt the pose from now on, with a hold that is latched."""
        self._doubted = True

    def checked(self, decision: FixtureDecision) -> FixtureDecision:
        """``decision``, without current planes while the pose is doubted: no motion, no retreat.

        The jump to a wrong place lasts for one sample, and what follows is plausible again.
        """
        new = not POSE_DOUBTS.isdisjoint(decision.reasons)
        self._doubted = decision.hold and (self._doubted or new)
        return replace(decision, constraint_is_current=False) if self._doubted else decision
