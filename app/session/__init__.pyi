from .advice import ADVICE, advice_text
from .axis_distances import AxisDistances
from .breach_log import BreachEntry, BreachList, BreachLog
from .breach_place import checked_axes, is_tip, place_letters
from .case_robot import load_case_robot
from .dwelling import mean_dwell_pose
from .frame_senders import FrameSenders, SenderConflict
from .from_case import MakeEngine, margin_parameters, robot_from_case, setup_from_case
from .inside_runs import InsideRun, InsideRuns
from .joint_clock import tip_signals, with_estimated_clock
from .known_edges import NO_EDGES, KnownEdges
from .live import LiveSession
from .live_control import (
    guidance_parameters,
    limiter_parameters,
    tumor_motion_parameters,
)
from .live_images import LiveImages
from .mesh_repair import with_repaired_meshes
from .path_depth import PathDepth, PathPoint, deepest_on_path
from .plausibility.plausibility import SINGLE_SOURCE
from .playback_rule import PlaybackRule
from .pose_tree import MeasuredPose, PoseTree
from .registering import box_corners
from .sender_trail import LEASE_NS, SILENT_NS, Sample, SenderTrail, has_ended
from .sequence_trail import SequenceTrail
from .session import Session
from .setup import REFERENCE, ProximityModel, RobotSetup, SessionSetup
from .setup_doubts import SetupDoubts
from .shown_state import SHOWN_STATES, STOP, ShownState, shown_state
from .step_result import StepResult
from .tool_engines import ToolEngines
from .tracking_error import TrackingError
from .tumor_change import TumorChange, tumor_change
from .tumor_replacement import TumorReplacement, load_replacement, prepare_replacement

__all__ = [
    "ADVICE",
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
    "Sample",
    "SenderConflict",
    "SenderTrail",
    "SequenceTrail",
    "Session",
    "SessionSetup",
    "SetupDoubts",
    "ShownState",
    "StepResult",
    "ToolEngines",
    "TrackingError",
    "TumorChange",
    "TumorReplacement",
    "advice_text",
    "box_corners",
    "checked_axes",
    "deepest_on_path",
    "guidance_parameters",
    "has_ended",
    "is_tip",
    "limiter_parameters",
    "load_case_robot",
    "load_replacement",
    "margin_parameters",
    "mean_dwell_pose",
    "place_letters",
    "prepare_replacement",
    "robot_from_case",
    "setup_from_case",
    "shown_state",
    "tip_signals",
    "tumor_change",
    "tumor_motion_parameters",
    "with_estimated_clock",
    "with_repaired_meshes",
]
