"""The breaches of a whole recording, for a display that plays it."""

from app.runtime.opening import PreparedCase
from app.runtime.replay_run import ReplayRun
from app.runtime.workflow.workflow_output import WorkflowOutput
from app.session import BreachList


def recorded_breaches(prepared: PreparedCase) -> BreachList:
    """Step through all of ``prepared``, which takes seconds, and list its breaches.

    Only before the case is played: a replay uses the same proximity engine.
    """
    workflow = WorkflowOutput(prepared.content)
    for _ in ReplayRun(prepared, clock_ns=lambda: 0, outputs=(workflow,)).steps():
        pass
    return workflow.breaches
