from .compliance import AdmittanceGains, HalfAxis, HandAdmittance, ImpedanceParameters, half_axis
from .control_file import (
    BASE,
    CONTROL,
    RULE_FRAME,
    ControlDescription,
    open_control,
)
from .controller import (
    ControlDecision,
    ControllerParameters,
    ControlReason,
    CooperativeController,
    JointMeasurement,
    PoseMeasurement,
    ToolKinematics,
    WrenchMeasurement,
)
from .warm_up import warm_up

__all__ = [
    "BASE",
    "CONTROL",
    "RULE_FRAME",
    "AdmittanceGains",
    "ControlDecision",
    "ControlDescription",
    "ControlReason",
    "ControllerParameters",
    "CooperativeController",
    "HalfAxis",
    "HandAdmittance",
    "ImpedanceParameters",
    "JointMeasurement",
    "PoseMeasurement",
    "ToolKinematics",
    "WrenchMeasurement",
    "half_axis",
    "open_control",
    "warm_up",
]
