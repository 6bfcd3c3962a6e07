"""A simulated lumpectomy with ground truth, which the demo replays."""

from app.synthetic.case_options import CaseErrors, CaseOptions
from app.synthetic.frame_names import BASE_FRAME, TIP_FRAME, TUMOR_FRAME
from app.synthetic.motion import ArmKinematics
from app.synthetic.recording import Recording
from app.synthetic.simulated_tracker import SimulatedTracker
from app.synthetic.simulation import Simulation, simulate
from app.synthetic.tracker_model import Jitter, TrackerModel
from app.synthetic.truth import Clearance, TrueBreach, find_breaches
from app.synthetic.tumour_and_tool import Tumour, tool_mesh
from app.synthetic.writing import simulate_case, simulate_unrecorded_case

__all__ = [
    "BASE_FRAME",
    "TIP_FRAME",
    "TUMOR_FRAME",
    "ArmKinematics",
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
