"""Checks of the tip of the tool that an operator has calibrated."""

from app.geometry import FrameError, InputError, Transform
from app.session import SessionSetup

MAX_TIP_SIGMA_MM = 10.0
"""Largest uncertainty of a calibrated tip."""

_SAME_AXIS_RAD = 1e-6


def check_tip(setup: SessionSetup, tool_from_tip: Transform, sigma_mm: float) -> None:
    """Raise unless ``tool_from_tip`` can replace the tip of the tool of ``setup``.

    `FrameError` for a tip between other frames, `InputError` for an uncertainty out of range, and
    for another axis of a tool whose mount on a robot was found with the axis in use.
    """
    known, robot = setup.tool_from_tip, setup.robot
    if (tool_from_tip.target, tool_from_tip.source) != (known.target, known.source):
        raise FrameError(
            f"tip: is {tool_from_tip.target}_from_{tool_from_tip.source}; expected "
            f"{known.target}_from_{known.source}"
        )
    if not 0.0 <= sigma_mm <= MAX_TIP_SIGMA_MM:
        raise InputError(
            f"uncertainty of the tip: is {sigma_mm:.6g} mm; expected 0 to {MAX_TIP_SIGMA_MM:g} mm"
        )
    is_mounted = robot is not None and robot.link_from_tip is not None
    if is_mounted and known.angle_to(tool_from_tip) > _SAME_AXIS_RAD:
        raise InputError(
            "tip: has another axis than the one with which the robot was registered; "
            "expected the same axis, or a session that is registered with the new one"
        )
