from .approach import Approach, ApproachError, plan_approach, prove_path
from .collision import CollisionModel, Contact
from .hit_probability import covariance_of, hit_probability
from .needle import NoCorridorError, plan_needle
from .needle_constraint import needle_constraint
from .needle_guidance import NeedleGuidance, NeedlePath, guide_needle
from .needle_places import EntryRegion, NeedleTarget
from .needle_reach import NeedleRobot
from .needle_values import Corridor, ForbiddenStructure, Needle, NeedlePlan
from .path_timing import MAX_DURATION_S, MotionLimits, limit_rows, shown_samples, time_path
from .preview import ApproachPreview, nearest_structures, preview_approach

__all__ = [
    "MAX_DURATION_S",
    "Approach",
    "ApproachError",
    "ApproachPreview",
    "CollisionModel",
    "Contact",
    "Corridor",
    "EntryRegion",
    "ForbiddenStructure",
    "MotionLimits",
    "Needle",
    "NeedleGuidance",
    "NeedlePath",
    "NeedlePlan",
    "NeedleRobot",
    "NeedleTarget",
    "NoCorridorError",
    "covariance_of",
    "guide_needle",
    "hit_probability",
    "limit_rows",
    "nearest_structures",
    "needle_constraint",
    "plan_approach",
    "plan_needle",
    "preview_approach",
    "prove_path",
    "shown_samples",
    "time_path",
]
