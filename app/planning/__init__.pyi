from .hit_probability import covariance_of, hit_probability
from .needle import NoCorridorError, plan_needle
from .needle_places import EntryRegion, NeedleTarget
from .needle_reach import NeedleRobot
from .needle_values import Corridor, ForbiddenStructure, Needle, NeedlePlan

__all__ = [
    "Corridor",
    "EntryRegion",
    "ForbiddenStructure",
    "Needle",
    "NeedlePlan",
    "NeedleRobot",
    "NeedleTarget",
    "NoCorridorError",
    "covariance_of",
    "hit_probability",
    "plan_needle",
]
