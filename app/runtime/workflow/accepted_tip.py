"""From an accepted calibration to the command of the session that uses it."""

from app.runtime.commands import OperatorCommands
from app.runtime.requests import RequestKind
from app.runtime.tracked_tool import TrackedTool
from app.runtime.workflow.tool_calibration import TipChange


def tip_request_kind(change: TipChange) -> RequestKind:
    """The kind of the request that `use_tip` makes."""
    return RequestKind.TIP if change.tool is TrackedTool.CAUTERY else RequestKind.STYLUS


def use_tip(commands: OperatorCommands, change: TipChange, origin: str) -> None:
    """Use the tip of ``change`` for its tool, and for no other one.

    Raises as `OperatorCommands.set_tip` or `OperatorCommands.set_stylus_tip`.
    """
    if change.tool is TrackedTool.CAUTERY:
        commands.set_tip(change.tool_from_tip, sigma_mm=change.sigma_mm, origin=origin)
    else:
        commands.set_stylus_tip(change.tool_from_tip, sigma_mm=change.sigma_mm, origin=origin)
