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
    positions_of,
)
from .path_follower import PathFollower, PlannedMotion, keeps_to_lines, lines_of
from .plan_execution import (
    FOLLOW_M,
    FOLLOW_RAD,
    START_M,
    START_RAD,
    ExecutionStep,
    Outcome,
    PlanExecution,
)
from .plan_file import Plan, named_faults, parse_plan, read_plan
from .warm_up import warm_up

__all__ = [
    "BASE",
    "CONTROL",
    "FOLLOW_M",
    "FOLLOW_RAD",
    "RULE_FRAME",
    "START_M",
    "START_RAD",
    "AdmittanceGains",
    "ControlDecision",
    "ControlDescription",
    "ControlReason",
    "ControllerParameters",
    "CooperativeController",
    "ExecutionStep",
    "HalfAxis",
    "HandAdmittance",
    "ImpedanceParameters",
    "JointMeasurement",
    "Outcome",
    "PathFollower",
    "Plan",
    "PlanExecution",
    "PlannedMotion",
    "PoseMeasurement",
    "ToolKinematics",
    "WrenchMeasurement",
    "half_axis",
    "keeps_to_lines",
    "lines_of",
    "named_faults",
    "open_control",
    "parse_plan",
    "positions_of",
    "read_plan",
    "warm_up",
]
