"""The guided recordings and the breaches of a session, fed with every step of its run."""

from app.runtime.content import SessionContent
from app.runtime.outputs import PassiveOutput, StepTiming, SwitchContent
from app.runtime.workflow.robot_registration import RobotRegistration
from app.runtime.workflow.tool_calibration import ToolCalibration
from app.session import BreachList, BreachLog, StepResult


class WorkflowOutput(PassiveOutput):
    """`Output` of a session with ``content``: a display may leave out steps, this leaves out none.

    ``calibration`` is that of the tool, ``registration`` that of the robot, None without one.
    """

    def __init__(self, content: SessionContent) -> None:
        self.calibration = ToolCalibration(content)
        self.registration = None if content.robot is None else RobotRegistration(content)
        self._content = content
        self.begin_ns: int | None = None
        """Stamp of the first step; None before it."""
        self._breach_log = BreachLog(content.tumor, content.margins.stale_after_ns)

    @property
    def breaches(self) -> BreachList:
        """The breaches up to the last step."""
        return self._breach_log.breaches

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Record the poses of ``step``, and whether the tool is in the tumour."""
        self.observe(step, self._content)
        return True

    def observe(self, step: StepResult, content: SessionContent) -> None:
        """As `publish`, of a step that was taken with ``content``."""
        self._use(content)
        if self.begin_ns is None:
            self.begin_ns = step.frame.stamp.ns
        self.calibration.observe(step)
        if self.registration is not None:
            self.registration.observe(step)
        self._breach_log.observe(step)

    def prepare(self, content: SessionContent) -> SwitchContent:
        """Nothing is slow here."""
        return self._use

    def _use(self, content: SessionContent) -> None:
        self._content = content
        self._breach_log.use(content.tumor, content.margins.stale_after_ns)
