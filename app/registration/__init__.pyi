from .errors import (
    CoincidentPointsError,
    CollinearPointsError,
    ConvergenceError,
    CovarianceError,
    DegenerateMotionError,
    FlatSignalError,
    FreeMotionError,
    MirroredPointsError,
    NoConsensusError,
    NotFiniteError,
    NoValidSamplesError,
    RegistrationError,
    ScaleMismatchError,
    ShapeError,
    TooFewError,
    UnequalCountsError,
)
from .points.dwells import Dwell, DwellSettings, detect_dwells
from .points.landmarks import (
    LandmarkDetection,
    LandmarkMatch,
    detect_landmarks,
    match_landmarks,
)
from .points.paired import register_points
from .points.robust import register_points_robust
from .points.surface import register_surface
from .poses import PoseNoise, select_poses, usable_poses
from .robot_base.robot_world import RobotWorldResult, solve_robot_world
from .robot_base.time_offset import TimeOffset, estimate_time_offset
from .robot_base.timed_signal import TimedSignal
from .tool.pivot import PivotResult, calibrate_pivot
from .tool.pivot_selection import expected_tip_sigma_mm, select_pivot_poses
from .tool.spin import SpinResult, calibrate_spin
from .tool.tip_frame import tip_transform
from .uncertainty.acceptance import AcceptanceLimits, evaluate_acceptance
from .uncertainty.drift import DriftBound, RegistrationDrift, check_drift
from .uncertainty.result import RegistrationResult, given_registration
from .uncertainty.tre import (
    predict_layout_tre,
    predict_tre,
    tre_covariances,
    tre_upper_bound,
)

__all__ = [
    "AcceptanceLimits",
    "CoincidentPointsError",
    "CollinearPointsError",
    "ConvergenceError",
    "CovarianceError",
    "DegenerateMotionError",
    "DriftBound",
    "Dwell",
    "DwellSettings",
    "FlatSignalError",
    "FreeMotionError",
    "LandmarkDetection",
    "LandmarkMatch",
    "MirroredPointsError",
    "NoConsensusError",
    "NoValidSamplesError",
    "NotFiniteError",
    "PivotResult",
    "PoseNoise",
    "RegistrationDrift",
    "RegistrationError",
    "RegistrationResult",
    "RobotWorldResult",
    "ScaleMismatchError",
    "ShapeError",
    "SpinResult",
    "TimeOffset",
    "TimedSignal",
    "TooFewError",
    "UnequalCountsError",
    "calibrate_pivot",
    "calibrate_spin",
    "check_drift",
    "detect_dwells",
    "detect_landmarks",
    "estimate_time_offset",
    "evaluate_acceptance",
    "expected_tip_sigma_mm",
    "given_registration",
    "match_landmarks",
    "predict_layout_tre",
    "predict_tre",
    "register_points",
    "register_points_robust",
    "register_surface",
    "select_pivot_poses",
    "select_poses",
    "solve_robot_world",
    "tip_transform",
    "tre_covariances",
    "tre_upper_bound",
    "usable_poses",
]
