"""From an accepted calibration to the command of the session that uses it."""

from app.runtime.operator_command import SetStylusTip, SetTip
from app.runtime.tracked_tool import TrackedTool
from app.runtime.workflow.tool_calibration import TipChange


def tip_command(change: TipChange) -> SetTip | SetStylusTip:
    """The command that uses the tip of ``change`` for its tool, and for no other one."""
    command = SetTip if change.tool is TrackedTool.CAUTERY else SetStylusTip
    return command(change.tool_from_tip, change.sigma_mm)
