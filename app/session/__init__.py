"""One pure step, from a tracker frame to a decision: where the rooms meet.

Registration, robot, case and fixture do not know each other; the session joins them.

Reads no clock and knows neither ROS nor VTK.
"""

from app.session.from_case import margin_parameters, setup_from_case
from app.session.joint_clock import tip_signals, with_estimated_clock
from app.session.live import LiveSession
from app.session.live_control import (
    guidance_parameters,
    limiter_parameters,
    tumor_motion_parameters,
)
from app.session.pose_tree import MeasuredPose, PoseTree
from app.session.session import Session, StepResult
from app.session.setup import REFERENCE, ProximityModel, RobotSetup, SessionSetup
from app.session.tumor_repair import with_repaired_tumor

__all__ = [
    "REFERENCE",
    "LiveSession",
    "MeasuredPose",
    "PoseTree",
    "ProximityModel",
    "RobotSetup",
    "Session",
    "SessionSetup",
    "StepResult",
    "guidance_parameters",
    "limiter_parameters",
    "margin_parameters",
    "setup_from_case",
    "tip_signals",
    "tumor_motion_parameters",
    "with_estimated_clock",
    "with_repaired_tumor",
]
