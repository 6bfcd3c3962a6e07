"""Breaches and guided recordings are fed with every step of a run."""

from types import SimpleNamespace

from app.runtime import ReplayRun, compute_here
from app.workflow import CalibrationKind, Workflow, WorkflowOutput
from tests.shipped_case import DEEP


def test_every_step_of_a_replay_reaches_recordings_and_breaches(recorded_case):
    content = recorded_case.content
    operator = SimpleNamespace(request=None, compute=compute_here)
    guided = Workflow(content, operator, lambda: None)
    workflow = WorkflowOutput(content, guided)
    guided.calibration.start(0, CalibrationKind.PIVOT)
    guided.registration.start(0)
    begin_s, end_s = DEEP["start_s"] - 1.0, DEEP["end_s"] + 1.0
    part = {"start_s": begin_s, "end_s": end_s, "outputs": (workflow,)}
    steps = list(ReplayRun(recorded_case, clock_ns=lambda: 0, **part).steps())
    distances_mm = [
        float(step.decision.proximity.signed_distance_mm)
        for step in steps
        if step.decision.proximity is not None
    ]
    assert workflow.breaches.count == 1
    assert workflow.breaches.deepest.depth_mm == -min(distances_mm)
    assert guided.calibration.status().samples > 0.9 * len(steps)
    assert guided.registration.status().samples > 0.9 * len(steps)
