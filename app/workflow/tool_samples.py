"""Poses of the tool that a session has measured, collected for a calibration."""

import numpy as np

from app.geometry import NS_PER_MS, FloatArray, FrameError
from app.runtime.tracked_tool import REFUSED
from app.session import REFERENCE, StepResult

MAX_POSES = 6000
"""Poses that are kept; a calibration needs some hundred."""

MIN_INTERVAL_NS = 15 * NS_PER_MS
"""Shortest time between two poses that are kept: a tracker of 1 kHz fills no list in seconds."""


class ToolSamples:
    """Poses of ``tool`` in the reference, or in its tracker's frame where there is no reference.

    The session's own rules decide which poses may be used: stale, lost, frozen and implausible ones
    are not among them. ``problem`` is why the last step gave none, empty if it did.
    """

    def __init__(self, tool: str) -> None:
        self.problem = ""
        self.reference = ""
        self._tool = tool
        self._last_ns: int | None = None
        self._rotations: list[FloatArray] = []
        self._translations_mm: list[FloatArray] = []

    def __len__(self) -> int:
        return len(self._rotations)

    @property
    def is_full(self) -> bool:
        """True if no more poses are kept."""
        return len(self) >= MAX_POSES

    def observe(self, step: StepResult) -> None:
        """Keep the pose of ``step``, if it is a new one."""
        self.problem = self._keep(step)

    def arrays(self) -> tuple[FloatArray, FloatArray]:
        """Copies of the rotations (n, 3, 3) and translations (n, 3) in mm, in order of time."""
        return np.array(self._rotations), np.array(self._translations_mm)

    def _keep(self, step: StepResult) -> str:
        refused = REFUSED.intersection(step.decision.reasons)
        if refused:
            return ", ".join(sorted(reason.text for reason in refused))
        if not self.reference:
            self.reference = self._reference(step)
        if not self.reference:
            return f"{self._tool!r} has not been tracked yet"
        try:
            pose, oldest = step.edges.between(self.reference, self._tool)
        except FrameError as error:
            return str(error)
        if oldest is None:
            return f"{self._tool!r} is not measured in {self.reference!r}"
        since_ns = None if self._last_ns is None else oldest.ns - self._last_ns
        if since_ns is not None and 0 <= since_ns < MIN_INTERVAL_NS:
            return ""
        if not self.is_full:
            self._last_ns = oldest.ns
            self._rotations.append(pose.rotation)
            self._translations_mm.append(pose.translation_mm)
        return ""

    def _reference(self, step: StepResult) -> str:
        measured = step.edges.measured
        if any(REFERENCE in edge for edge in measured):
            return REFERENCE
        return next((target for target, source in measured if source == self._tool), "")
