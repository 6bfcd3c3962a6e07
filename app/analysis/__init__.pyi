from .breach_probability import BreachProbability, breach_probability
from .case_analysis import PHASES, CaseAnalysis, analyse_case, phases_of
from .case_breaches import AnalysedBreach, DepthEstimate, estimate_depth
from .coverage import Coverage, coverage_of
from .insertion import Insertion, case_insertion, insertion_metrics
from .motion import Motion, motion_of
from .samples import Breach, CaseSamples, find_breaches
from .smoothing import Jitter, estimate_jitter

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
