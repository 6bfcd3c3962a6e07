from .breaches import Breach, find_breaches
from .case_analysis import CaseAnalysis, analyse_case
from .case_breaches import AnalysedBreach
from .depth import DepthEstimate, estimate_depth
from .jitter import Jitter, estimate_jitter
from .motion import Motion, motion_of
from .phases import PHASES, phases_of
from .samples import CaseSamples

__all__ = [
    "PHASES",
    "AnalysedBreach",
    "Breach",
    "CaseAnalysis",
    "CaseSamples",
    "DepthEstimate",
    "Jitter",
    "Motion",
    "analyse_case",
    "estimate_depth",
    "estimate_jitter",
    "find_breaches",
    "motion_of",
    "phases_of",
]
