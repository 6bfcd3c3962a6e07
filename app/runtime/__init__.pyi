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

__all__ = [
    "MAX_BODY_TRIANGLES",
    "SWITCH_INTERVAL_S",
    "AddNote",
    "AuditLog",
    "AuditOutput",
    "BetweenSteps",
    "BodyKind",
    "CaseRecorder",
    "ChooseDepth",
    "Compute",
    "ComputeProcess",
    "Deliver",
    "DeliveredStep",
    "DescribedSession",
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
    "PreparedCase",
    "PreparedLive",
    "QtSpinner",
    "Rearm",
    "ReceivedConstraint",
    "Record",
    "RecordingExtent",
    "RecordingStatus",
    "RegisteredCase",
    "ReplayRun",
    "RequestKind",
    "RequestLog",
    "RequestOutcome",
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
    "TooManyRequestsError",
    "TrackedTool",
    "Wakeup",
    "WorldBody",
    "WorldMoment",
    "WorldRequest",
    "compute_here",
    "content_of",
    "described_images",
    "mesh_digest",
    "open_recording",
    "place_text",
    "playback_of",
    "prepare_case",
    "prepare_live",
    "register_case",
    "stylus_text",
    "text_digest",
    "tip_mm",
    "tip_of",
    "used_values",
]
