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
from .path_follower import PathFollower, PlannedMotion
from .plan_execution import ExecutionStep, Outcome, PlanExecution
from .plan_file import ShownPlan, parse_plan, parse_shown_plan, read_plan, read_shown_plan
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
    "ExecutionStep",
    "HalfAxis",
    "HandAdmittance",
    "ImpedanceParameters",
    "JointMeasurement",
    "Outcome",
    "PathFollower",
    "PlanExecution",
    "PlannedMotion",
    "PoseMeasurement",
    "ShownPlan",
    "ToolKinematics",
    "WrenchMeasurement",
    "half_axis",
    "open_control",
    "parse_plan",
    "parse_shown_plan",
    "positions_of",
    "read_plan",
    "read_shown_plan",
    "warm_up",
]
