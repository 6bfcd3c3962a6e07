"""A simulated lumpectomy with ground truth: the case that the demo replays."""

from app.case.simulate.cautery import CAUTERY_TIP_FRAME, cautery_mesh
from app.case.simulate.clearance import Clearance
from app.case.simulate.motion import ArmKinematics
from app.case.simulate.simulation import BASE_FRAME, Simulation, simulate
from app.case.simulate.tracker import Jitter
from app.case.simulate.truth import TrueBreach, find_breaches
from app.case.simulate.tumour import TUMOR_FRAME, Tumour
from app.case.simulate.writing import simulate_case

__all__ = [
    "BASE_FRAME",
    "CAUTERY_TIP_FRAME",
    "TUMOR_FRAME",
    "ArmKinematics",
    "Clearance",
    "Jitter",
    "Simulation",
    "TrueBreach",
    "Tumour",
    "cautery_mesh",
    "find_breaches",
    "simulate",
    "simulate_case",
]
