from .breach_probability import BreachProbability, breach_probability
from .breaches import Breach, find_breaches
from .case_analysis import CaseAnalysis, analyse_case
from .case_breaches import AnalysedBreach
from .coverage import Coverage, coverage_of
from .depth import DepthEstimate, estimate_depth
from .insertion import Insertion, case_insertion, insertion_metrics
from .jitter import Jitter, estimate_jitter
from .motion import Motion, motion_of
from .phases import PHASES, phases_of
from .samples import CaseSamples

__all__ = [
    "PHASES",
    "AnalysedBreach",
    "Breach",
    "BreachProbability",
    "CaseAnalysis",
    "CaseSamples",
    "Coverage",
    "DepthEstimate",
    "Insertion",
    "Jitter",
    "Motion",
    "analyse_case",
    "breach_probability",
    "case_insertion",
    "coverage_of",
    "estimate_depth",
    "estimate_jitter",
    "find_breaches",
    "insertion_metrics",
    "motion_of",
    "phases_of",
]
