"""Outputs of a live node besides its publisher: allowed twists, guidance, log."""

import threading

from app.bridge.control import GuidancePublisher, TwistLimiter
from app.bridge.node import RosNode
from app.bridge.steady_clock import steady_ns
from app.fixture import MarginParameters
from app.geometry import ImageSample
from app.runtime import ImageDescription, PassiveOutput, SessionContent, StepTiming, SwitchContent
from app.session import SessionSetup, SetupDoubts, StepResult


class TwistOutput(PassiveOutput):
    """`Output` that lets ``limiter`` allow the motion of the last step while its data are valid."""

    def __init__(self, limiter: TwistLimiter, margins: MarginParameters) -> None:
        self._limiter = limiter
        self._margins = margins

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Allow the motion of ``step``; none if an earlier output found the step too late."""
        if timing.in_time:
            # Read before the time that has been spent: a stop in between shortens the validity.
            since_ns = steady_ns()
            self._limiter.allow(step, self._margins, timing.spent_now_ns(), since_ns)
        else:
            self._limiter.forbid()
        return True

    def prepare(self, content: SessionContent) -> SwitchContent:
        """Return the switch; nothing needs to be prepared."""
        return self._use

    def revoke(self) -> None:
        """Allow no motion until the next step."""
        self._limiter.forbid()

    def end(self) -> None:
        """Allow no motion."""
        self._limiter.forbid()

    def _use(self, content: SessionContent) -> None:
        self._margins = content.margins


class GuidanceOutput(PassiveOutput):
    """`Output` that publishes the guidance wrench of each step, and zero at the end."""

    def __init__(self, guidance: GuidancePublisher) -> None:
        self._guidance = guidance

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Publish the wrench of ``step``."""
        self._guidance.publish(step)
        return True

    def end(self) -> None:
        """Publish a zero wrench."""
        self._guidance.stop()


class FramesProblemLog(PassiveOutput):
    """`Output` that logs each kind of problem with the tracker's frames once."""

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._last: tuple[str, ...] = ()
        self._logged: set[str] = set()

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Log a new kind of problem; the details behind its colon may change."""
        if step.frames_problems != self._last:
            self._last = step.frames_problems
            for problem in step.frames_problems:
                kind = problem.partition(":")[0]
                if kind not in self._logged:
                    self._logged.add(kind)
                    self._ros.node.get_logger().warning(problem)
        return True


class SetupDoubtLog(PassiveOutput):
    """`Output` that logs each doubt about ``setup`` once."""

    def __init__(self, ros: RosNode, setup: SessionSetup) -> None:
        self._ros = ros
        self._doubts = SetupDoubts(setup)
        self._logged: set[str] = set()

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Log a new doubt; its numbers may change."""
        for text in self._doubts.observe(step):
            what = text.partition(":")[0]
            if what not in self._logged:
                self._logged.add(what)
                self._ros.node.get_logger().warning(f"check the set-up: {text}")
        return True

    def prepare(self, content: SessionContent) -> SwitchContent:
        """Return the switch; nothing needs to be prepared."""
        return self._use

    def _use(self, content: SessionContent) -> None:
        self._doubts.stale_after_ns = content.margins.stale_after_ns
        self._doubts.use_tip(content.tool_from_tip)


class PlaybackLog(PassiveOutput):
    """`Output` that logs the beginning and the end of a playback of a recording.

    The name of the case may be known some steps after the beginning; then it is logged as well.
    """

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._logged = ""

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Log a playback that has begun or ended."""
        if step.playback != self._logged:
            self._logged = step.playback
            text = f"PLAYBACK: {step.playback}" if step.playback else "the PLAYBACK has ended"
            self._ros.node.get_logger().warning(text)
        return True


class ChosenDepth(PassiveOutput):
    """`Output` that follows the imaging depth, for recordings and for images over OpenIGTLink.

    ``choice``: the depth in mm that was chosen last, and the stamp in ns after which it holds; None
    before the first. ``images`` are those of the session.
    """

    def __init__(self, content: SessionContent, images: ImageDescription | None) -> None:
        self.choice: tuple[float, int] | None = None
        self._depth = content.image_depth
        self._depths = None if images is None else images.depths()
        self._lock = threading.Lock()
        self._newest_ns = 0

    def check(self, image: ImageSample) -> None:
        """Raise `InputError` for an image whose stated size of a pixel is that of another depth."""
        if self._depths is not None and image.stamp is not None:
            with self._lock:
                self._depths.check(image.stamp.ns, image.pixel_mm)

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Note the time of ``step``."""
        self._newest_ns = step.frame.stamp.ns
        return True

    def prepare(self, content: SessionContent) -> SwitchContent:
        """Return the switch; nothing needs to be prepared."""
        return self._use

    def _use(self, content: SessionContent) -> None:
        if content.image_depth is not None and content.image_depth != self._depth:
            depth_mm = content.image_depth.depth_mm
            self.choice = depth_mm, self._newest_ns
            if self._depths is not None:
                with self._lock:
                    self._depths.choose(depth_mm, self._newest_ns)
        self._depth = content.image_depth
