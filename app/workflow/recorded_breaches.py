"""The breaches of a whole recording, for a display that plays it."""

from app.runtime.opening import PreparedCase
from app.runtime.replay_run import ReplayRun
from app.session import BreachList, BreachLog


def recorded_breaches(prepared: PreparedCase) -> BreachList:
    """Step through all of ``prepared``, which takes seconds, and list its breaches.

    Only before the case is played: a replay uses the same proximity engine.
    """
    content = prepared.content
    log = BreachLog(content.tumor, content.margins.stale_after_ns)
    for step in ReplayRun(prepared, clock_ns=lambda: 0).steps():
        log.observe(step)
    return log.breaches
