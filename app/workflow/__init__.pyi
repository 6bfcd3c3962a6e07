from .calibration_fit import CalibrationFit, CalibrationKind, CalibrationTask, fit_calibration
from .contour_tumor import ContourTumor
from .coverage import Coverage
from .event_notes import EventNote, EventNotes
from .guided_fits import GuidedFits
from .guided_recording import DisplayOperator, Phase
from .guided_text import GuidedShown, TouchedPoint, calibration_shown, registration_shown
from .recorded_breaches import recorded_breaches
from .registration_fit import RegistrationFit, RegistrationTask, fit_registration
from .robot_registration import RegistrationStatus, RobotRegistration
from .steps import WorkflowName, WorkflowState, WorkflowStep, next_step, workflow_steps
from .stop_surface import stop_surface
from .tip_directions import TipDirections
from .tool_calibration import CalibrationStatus, TipChange, ToolCalibration, tip_command
from .workflow import Workflow, WorkflowOutput

__all__ = [
    "CalibrationFit",
    "CalibrationKind",
    "CalibrationStatus",
    "CalibrationTask",
    "ContourTumor",
    "Coverage",
    "DisplayOperator",
    "EventNote",
    "EventNotes",
    "GuidedFits",
    "GuidedShown",
    "Phase",
    "RegistrationFit",
    "RegistrationStatus",
    "RegistrationTask",
    "RobotRegistration",
    "TipChange",
    "TipDirections",
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
    "recorded_breaches",
    "registration_shown",
    "stop_surface",
    "tip_command",
    "workflow_steps",
]
