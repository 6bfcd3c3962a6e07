"""What of a replay goes into its scene file and its movie, kept while it runs."""

from typing import TYPE_CHECKING

from app.cli.keyframes import Reel
from app.runtime import PassiveOutput

if TYPE_CHECKING:
    from app.fixture import MarginState, Reason
    from app.geometry import TrackedTransform
    from app.runtime import StepTiming
    from app.session import StepResult


class SceneLog(PassiveOutput):
    """`Output` that keeps of every step what the scene file and the movie need."""

    def __init__(self, *, recording: bool, pictures: int | None) -> None:
        """``pictures``: how many the movie may have; None for no movie."""
        self._keeps_recording = recording
        self.frames: list[tuple[TrackedTransform, ...]] = []
        """The samples of each acquisition."""
        self.states: list[tuple[int, MarginState, tuple[Reason, ...]]] = []
        """The stamp in ns, what was judged, and why."""
        self._reel = None if pictures is None else Reel(pictures)
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
        if self._reel is not None:
            self._reel.add(step)
        return True

    def keyframes(self) -> list[tuple[float, "StepResult"]]:
        """The steps of the movie with their times in s from the first frame."""
        from app.geometry import NS_PER_S

        if self._reel is None or self.first_ns is None:
            return []
        return [
            ((step.frame.stamp.ns - self.first_ns) / NS_PER_S, step) for step in self._reel.steps()
        ]
