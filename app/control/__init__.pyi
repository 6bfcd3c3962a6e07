from .admittance import AdmittanceGains, HandAdmittance
from .controller import (
    ControlDecision,
    ControllerParameters,
    ControlReason,
    CooperativeController,
)
from .measurements import JointMeasurement, PoseMeasurement, WrenchMeasurement
from .tool_kinematics import ToolKinematics

__all__ = [
    "AdmittanceGains",
    "ControlDecision",
    "ControlReason",
    "ControllerParameters",
    "CooperativeController",
    "HandAdmittance",
    "JointMeasurement",
    "PoseMeasurement",
    "ToolKinematics",
    "WrenchMeasurement",
]
