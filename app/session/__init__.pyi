from .axis_distances import AxisDistances
from .breach_log import (
    BreachEntry,
    BreachList,
    BreachLog,
    InsideRun,
    InsideRuns,
    checked_axes,
    is_tip,
    place_letters,
)
from .case_preparation import (
    box_corners,
    load_case_robot,
    mean_dwell_pose,
    tip_signals,
    with_estimated_clock,
    with_repaired_meshes,
)
from .case_setup import MakeEngine, ToolEngines, margin_parameters, robot_from_case, setup_from_case
from .frame_senders import (
    LEASE_NS,
    SILENT_NS,
    FrameSenders,
    Sample,
    SenderConflict,
    SenderTrail,
    SequenceTrail,
    has_ended,
)
from .live_images import LiveImages
from .live_session import LiveSession, PlaybackRule
from .moment_text import moment_text
from .path_depth import PathDepth, PathPoint, deepest_on_path
from .pose_plausibility import SINGLE_SOURCE
from .pose_tree import MeasuredPose, PoseTree
from .session import Session
from .setup import (
    REFERENCE,
    RobotSetup,
    SessionSetup,
    TrackingError,
    guidance_parameters,
    limiter_parameters,
    tumor_motion_parameters,
)
from .setup_doubts import SetupDoubts
from .shown_state import (
    ADVICE,
    HOLD,
    SHOWN_STATES,
    STOP,
    ShownState,
    advice_text,
    banner_states,
    governing_name,
    margin_display,
    named,
    structure_title,
)
from .step_result import NO_EDGES, KnownEdges, StepResult
from .structure import ProximityModel, Role, Structure
from .structure_guard import StructureStep
from .tumor_replacement import (
    TumorChange,
    TumorReplacement,
    load_replacement,
    prepare_replacement,
    tumor_change,
)

__all__ = [
    "ADVICE",
    "HOLD",
    "LEASE_NS",
    "NO_EDGES",
    "REFERENCE",
    "SHOWN_STATES",
    "SILENT_NS",
    "SINGLE_SOURCE",
    "STOP",
    "AxisDistances",
    "BreachEntry",
    "BreachList",
    "BreachLog",
    "FrameSenders",
    "InsideRun",
    "InsideRuns",
    "KnownEdges",
    "LiveImages",
    "LiveSession",
    "MakeEngine",
    "MeasuredPose",
    "PathDepth",
    "PathPoint",
    "PlaybackRule",
    "PoseTree",
    "ProximityModel",
    "RobotSetup",
    "Role",
    "Sample",
    "SenderConflict",
    "SenderTrail",
    "SequenceTrail",
    "Session",
    "SessionSetup",
    "SetupDoubts",
    "ShownState",
    "StepResult",
    "Structure",
    "StructureStep",
    "ToolEngines",
    "TrackingError",
    "TumorChange",
    "TumorReplacement",
    "advice_text",
    "banner_states",
    "box_corners",
    "checked_axes",
    "deepest_on_path",
    "governing_name",
    "guidance_parameters",
    "has_ended",
    "is_tip",
    "limiter_parameters",
    "load_case_robot",
    "load_replacement",
    "margin_display",
    "margin_parameters",
    "mean_dwell_pose",
    "moment_text",
    "named",
    "place_letters",
    "prepare_replacement",
    "robot_from_case",
    "setup_from_case",
    "structure_title",
    "tip_signals",
    "tumor_change",
    "tumor_motion_parameters",
    "with_estimated_clock",
    "with_repaired_meshes",
]
