from .case_options import CaseErrors, CaseOptions
from .recording import Recording
from .simulated_tracker import SimulatedTracker
from .simulation import Simulation, simulate
from .tracker_model import Jitter, TrackerModel
from .truth import Clearance, TrueBreach, find_breaches
from .tumour_and_tool import BASE_FRAME, TIP_FRAME, TUMOR_FRAME, Tumour, tool_mesh
from .writing import simulate_case, simulate_unrecorded_case

__all__ = [
    "BASE_FRAME",
    "TIP_FRAME",
    "TUMOR_FRAME",
    "CaseErrors",
    "CaseOptions",
    "Clearance",
    "Jitter",
    "Recording",
    "SimulatedTracker",
    "Simulation",
    "TrackerModel",
    "TrueBreach",
    "Tumour",
    "find_breaches",
    "simulate",
    "simulate_case",
    "simulate_unrecorded_case",
    "tool_mesh",
]
