"""Keeps what the scene file and the movie of a replay need, while it runs."""

from typing import TYPE_CHECKING

from app.cli.keyframes import KeyframeSelector
from app.runtime import PassiveOutput

if TYPE_CHECKING:
    from app.fixture import MarginState, Reason
    from app.geometry import TrackedTransform
    from app.runtime import StepTiming
    from app.session import StepResult


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
        from app.geometry import NS_PER_S

        if self._selector is None or self.first_ns is None:
            return []
        return [
            ((step.frame.stamp.ns - self.first_ns) / NS_PER_S, step)
            for step in self._selector.steps()
        ]
