"""From measurements to transforms, and how far to trust them: pure functions, no clock, no files.

Imports `app.geometry` only. Every result says whether it is accepted and why; what cannot be
computed is refused with an error that names the cause.
"""

from app.registration.acceptance import AcceptanceLimits, judge
from app.registration.drift import DriftBound, RegistrationDrift, check_drift
from app.registration.dwells import Dwell, DwellSettings, detect_dwells
from app.registration.errors import (
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
from app.registration.landmarks import (
    LandmarkDetection,
    LandmarkMatch,
    detect_landmarks,
    match_landmarks,
)
from app.registration.pivot import PivotResult, calibrate_pivot
from app.registration.points import register_points
from app.registration.poses import PoseNoise, select_poses, usable_poses
from app.registration.result import RegistrationResult, given_registration
from app.registration.robot_world import RobotWorldResult, solve_robot_world
from app.registration.robust_points import register_points_robust
from app.registration.spin import SpinResult, calibrate_spin
from app.registration.surface import register_surface
from app.registration.time_offset import TimeOffset, estimate_time_offset
from app.registration.timed_signal import TimedSignal
from app.registration.tip_frame import tip_transform
from app.registration.tre import (
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
    "given_registration",
    "judge",
    "match_landmarks",
    "predict_layout_tre",
    "predict_tre",
    "register_points",
    "register_points_robust",
    "register_surface",
    "select_poses",
    "solve_robot_world",
    "tip_transform",
    "tre_covariances",
    "tre_upper_bound",
    "usable_poses",
]
