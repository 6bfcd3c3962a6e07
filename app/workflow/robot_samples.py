"""Poses of a robot's link by its joints, and of the tracked tool at it, at the same moments."""

import numpy as np

from app.geometry import FloatArray, FrameError, Transform
from app.runtime.content import SessionContent
from app.runtime.tracked_tool import REFUSED, TrackedTool, tip_of
from app.session import REFERENCE, RobotSetup, StepResult, box_corners
from app.workflow.registration_fit import Interval, RegistrationTask
from app.workflow.tool_samples import MIN_INTERVAL_NS

MAX_SAMPLES = 30_000
"""Samples that are kept: 7 minutes or more."""


class RobotSamples:
    """Samples of steps in which ``tool`` and joints are both known.

    ``problem`` is why the last step gave none, empty if it did.
    """

    def __init__(self, tool: TrackedTool = TrackedTool.CAUTERY) -> None:
        self.problem = ""
        self._touch = tool
        self._times_ns: list[int] = []
        self._tool: list[Transform] = []
        self._link: list[Transform] = []
        self._reference_from_tumor_frame: Transform | None = None

    def __len__(self) -> int:
        return len(self._times_ns)

    def observe(self, step: StepResult, content: SessionContent, robot: RobotSetup) -> None:
        """Keep the poses of ``step``, if they are new."""
        self.problem = self._keep(step, content, robot)

    def snapshot(self) -> "RobotSamples":
        """The samples so far. 30,000 of them take a millisecond, for which steps wait."""
        copied = RobotSamples(self._touch)
        copied._times_ns = self._times_ns.copy()
        copied._tool, copied._link = self._tool.copy(), self._link.copy()
        copied._reference_from_tumor_frame = self._reference_from_tumor_frame
        return copied

    def task(
        self, run: int, content: SessionContent, robot: RobotSetup, excluded: tuple[Interval, ...]
    ) -> RegistrationTask:
        """The samples so far, to be fitted. 30,000 of them take 0.1 s."""
        frame_from_tumor = next(e for e in content.static_edges if e.source == content.tumor.frame)
        targets_mm: FloatArray | None = None
        if self._reference_from_tumor_frame is not None:
            placed = self._reference_from_tumor_frame @ frame_from_tumor
            targets_mm = placed.apply(box_corners(content.tumor))
        return RegistrationTask(
            run=run,
            times_ns=tuple(self._times_ns),
            tool_rotations=np.array([each.rotation for each in self._tool]),
            tool_translations_mm=np.array([each.translation_mm for each in self._tool]),
            link_rotations=np.array([each.rotation for each in self._link]),
            link_translations_mm=np.array([each.translation_mm for each in self._link]),
            tool_from_tip=tip_of(content, self._touch),
            base_frame=robot.base_frame,
            tool_link=robot.tool_link,
            excluded=excluded,
            targets_mm=targets_mm,
            tool=self._touch,
        )

    def _keep(self, step: StepResult, content: SessionContent, robot: RobotSetup) -> str:
        refused = REFUSED.intersection(step.decision.reasons)
        if refused:
            return ", ".join(sorted(reason.text for reason in refused))
        tumor_frame = next(
            (e.target for e in content.static_edges if e.source == content.tumor.frame), ""
        )
        try:
            tool, oldest = step.edges.between(REFERENCE, tip_of(content, self._touch).target)
            link, joints = step.edges.between(robot.base_frame, robot.tool_link)
        except FrameError as error:
            return str(error)
        if oldest is None or joints is None:
            return f"the {self._touch} is not tracked, or the robot sends no joints"
        if len(self) >= MAX_SAMPLES:
            return f"{len(self)} samples are recorded, and no more are: stop"
        since_ns = MIN_INTERVAL_NS if not self._times_ns else oldest.ns - self._times_ns[-1]
        if since_ns < 0:
            return "the tracker's clock went back; discard, and begin again"
        if since_ns >= MIN_INTERVAL_NS:
            self._times_ns.append(oldest.ns)
            self._tool.append(tool)
            self._link.append(link)
            try:
                self._reference_from_tumor_frame, _ = step.edges.between(REFERENCE, tumor_frame)
            except FrameError:
                return ""  # the place of the tumour is that of an earlier step
        return ""
