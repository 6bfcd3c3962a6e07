from .audit import AuditLog, AuditOutput
from .case_recorder import CaseRecorder, RecordingStatus
from .commands import BetweenSteps, OperatorCommands
from .compute import Compute, ComputeProcess, compute_here
from .content import SessionContent, content_of
from .hold_keeper import HoldKeeper, used_values
from .image_depth import ImageDepth, ImageDescription, described_images
from .image_intake import ImageIntake, ImageSink
from .latest_value import SWITCH_INTERVAL_S, LatestValue
from .live_run import LiveRun
from .needle import Needle
from .opening import (
    PreparedCase,
    PreparedLive,
    RecordingExtent,
    RegisteredCase,
    open_recording,
    playback_of,
    prepare_case,
    prepare_live,
    register_case,
)
from .operator_command import (
    AddNote,
    ChooseDepth,
    LengthenNeedle,
    LocalOperator,
    Operator,
    OperatorCommand,
    Rearm,
    Record,
    SetMargins,
    SetRegistration,
    SetStylusTip,
    SetTip,
    SetTumor,
)
from .outputs import Output, PassiveOutput, StepHolds, StepTiming, SwitchContent
from .qt_spinner import QtSpinner
from .received_constraint import ReceivedConstraint
from .replay_run import ReplayRun
from .requests import OperatorRequest, RequestKind, RequestLog, TooManyRequestsError
from .session_wire import DescribedSession, SessionWire, mesh_digest, text_digest
from .shown_changes import ShownChange
from .simulated_world import (
    MAX_BODY_TRIANGLES,
    BodyKind,
    RequestOutcome,
    SimulatedWorld,
    WorldBody,
    WorldMoment,
    WorldRequest,
    place_text,
)
from .sources import Deliver, Source
from .step_thread import DeliveredStep, StepRun, StepThread
from .stylus import Stylus
from .tracked_tool import TrackedTool, stylus_text, tip_mm, tip_of
from .wakeup import Wakeup
from .workflow.accepted_tip import tip_command
from .workflow.calibration_fit import (
    CalibrationFit,
    CalibrationKind,
    CalibrationTask,
    fit_calibration,
)
from .workflow.coverage import Coverage
from .workflow.event_notes import EventNote, EventNotes
from .workflow.guided_fits import GuidedFits
from .workflow.guided_recording import Phase
from .workflow.guided_text import (
    calibration_count,
    calibration_numbers,
    calibration_title,
    calibration_verdict,
    coverage_text,
    registration_count,
    registration_verdict,
)
from .workflow.recorded_breaches import recorded_breaches
from .workflow.registration_fit import RegistrationFit, RegistrationTask, fit_registration
from .workflow.robot_registration import (
    RegistrationStatus,
    RobotRegistration,
    UseRegistration,
)
from .workflow.steps import (
    WorkflowName,
    WorkflowState,
    WorkflowStep,
    next_step,
    workflow_steps,
)
from .workflow.stop_surface import stop_surface
from .workflow.tip_directions import TipDirections
from .workflow.tool_calibration import CalibrationStatus, TipChange, ToolCalibration, UseTip
from .workflow.workflow_output import WorkflowOutput

__all__ = [
    "MAX_BODY_TRIANGLES",
    "SWITCH_INTERVAL_S",
    "AddNote",
    "AuditLog",
    "AuditOutput",
    "BetweenSteps",
    "BodyKind",
    "CalibrationFit",
    "CalibrationKind",
    "CalibrationStatus",
    "CalibrationTask",
    "CaseRecorder",
    "ChooseDepth",
    "Compute",
    "ComputeProcess",
    "Coverage",
    "Deliver",
    "DeliveredStep",
    "DescribedSession",
    "EventNote",
    "EventNotes",
    "GuidedFits",
    "HoldKeeper",
    "ImageDepth",
    "ImageDescription",
    "ImageIntake",
    "ImageSink",
    "LatestValue",
    "LengthenNeedle",
    "LiveRun",
    "LocalOperator",
    "Needle",
    "Operator",
    "OperatorCommand",
    "OperatorCommands",
    "OperatorRequest",
    "Output",
    "PassiveOutput",
    "Phase",
    "PreparedCase",
    "PreparedLive",
    "QtSpinner",
    "Rearm",
    "ReceivedConstraint",
    "Record",
    "RecordingExtent",
    "RecordingStatus",
    "RegisteredCase",
    "RegistrationFit",
    "RegistrationStatus",
    "RegistrationTask",
    "ReplayRun",
    "RequestKind",
    "RequestLog",
    "RequestOutcome",
    "RobotRegistration",
    "SessionContent",
    "SessionWire",
    "SetMargins",
    "SetRegistration",
    "SetStylusTip",
    "SetTip",
    "SetTumor",
    "ShownChange",
    "SimulatedWorld",
    "Source",
    "StepHolds",
    "StepRun",
    "StepThread",
    "StepTiming",
    "Stylus",
    "SwitchContent",
    "TipChange",
    "TipDirections",
    "TooManyRequestsError",
    "ToolCalibration",
    "TrackedTool",
    "UseRegistration",
    "UseTip",
    "Wakeup",
    "WorkflowName",
    "WorkflowOutput",
    "WorkflowState",
    "WorkflowStep",
    "WorldBody",
    "WorldMoment",
    "WorldRequest",
    "calibration_count",
    "calibration_numbers",
    "calibration_title",
    "calibration_verdict",
    "compute_here",
    "content_of",
    "coverage_text",
    "described_images",
    "fit_calibration",
    "fit_registration",
    "mesh_digest",
    "next_step",
    "open_recording",
    "place_text",
    "playback_of",
    "prepare_case",
    "prepare_live",
    "recorded_breaches",
    "register_case",
    "registration_count",
    "registration_verdict",
    "stop_surface",
    "stylus_text",
    "text_digest",
    "tip_command",
    "tip_mm",
    "tip_of",
    "used_values",
    "workflow_steps",
]
