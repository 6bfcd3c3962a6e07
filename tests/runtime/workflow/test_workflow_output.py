"""Breaches and guided recordings are fed with every step of a run."""

from app.runtime import CalibrationKind, ReplayRun, WorkflowOutput, prepare_case
from tests.shipped_case import DEEP


def test_every_step_of_a_replay_reaches_recordings_and_breaches(project_root):
    prepared = prepare_case(project_root / "data" / "recorded_case")
    workflow = WorkflowOutput(prepared.content)
    workflow.calibration.start(0, CalibrationKind.PIVOT)
    workflow.registration.start(0)
    begin_s, end_s = DEEP["start_s"] - 1.0, DEEP["end_s"] + 1.0
    run = ReplayRun(prepared, clock_ns=lambda: 0, start_s=begin_s, end_s=end_s, outputs=(workflow,))
    steps = list(run.steps())
    distances_mm = [
        float(step.decision.proximity.signed_distance_mm)
        for step in steps
        if step.decision.proximity is not None
    ]
    assert workflow.breaches.count == 1
    assert workflow.breaches.deepest.depth_mm == -min(distances_mm)
    assert workflow.calibration.status().samples > 0.9 * len(steps)
    assert workflow.registration.status().samples > 0.9 * len(steps)
