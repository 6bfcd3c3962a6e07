from .approach_ghost import ApproachGhost, GhostShown, ShownPlan
from .calibration_fit import (
    CalibrationFit,
    CalibrationKind,
    CalibrationTask,
    Coverage,
    fit_calibration,
)
from .contour_tumor import ContourTumor
from .goal_pose import GoalPose, GoalShown
from .guided_recording import DisplayOperator, GuidedFits, Phase
from .guided_text import GuidedShown, TouchedPoint, calibration_shown, registration_shown
from .needle_guide import RANGE_MM, RINGS_MM, NeedleGuide, NeedleShown
from .registration_fit import RegistrationFit, RegistrationTask, fit_registration
from .robot_registration import RegistrationStatus, RobotRegistration
from .session_corridors import SessionCorridors, plan_corridors
from .steps import WorkflowName, WorkflowState, WorkflowStep, next_step, workflow_steps
from .tool_calibration import CalibrationStatus, TipChange, ToolCalibration, tip_command
from .workflow import EventNote, EventNotes, Workflow, WorkflowOutput, recorded_breaches

__all__ = [
    "RANGE_MM",
    "RINGS_MM",
    "ApproachGhost",
    "CalibrationFit",
    "CalibrationKind",
    "CalibrationStatus",
    "CalibrationTask",
    "ContourTumor",
    "Coverage",
    "DisplayOperator",
    "EventNote",
    "EventNotes",
    "GhostShown",
    "GoalPose",
    "GoalShown",
    "GuidedFits",
    "GuidedShown",
    "NeedleGuide",
    "NeedleShown",
    "Phase",
    "RegistrationFit",
    "RegistrationStatus",
    "RegistrationTask",
    "RobotRegistration",
    "SessionCorridors",
    "ShownPlan",
    "TipChange",
    "ToolCalibration",
    "TouchedPoint",
    "Workflow",
    "WorkflowName",
    "WorkflowOutput",
    "WorkflowState",
    "WorkflowStep",
    "calibration_shown",
    "fit_calibration",
    "fit_registration",
    "next_step",
    "plan_corridors",
    "recorded_breaches",
    "registration_shown",
    "tip_command",
    "workflow_steps",
]
