"""The analysis of a replay for its report."""

from typing import TYPE_CHECKING

from app.report.analysis_html import AnalysedCase
from app.report.methods import methods_of

if TYPE_CHECKING:
    from app.report.record import ReplayLog
    from app.runtime import ReplayRun


def analysed_replay(run: "ReplayRun", log: "ReplayLog", program: str) -> AnalysedCase | None:
    """Analyse the steps of ``run`` that ``log`` has received; None without a step.

    ``program`` is the version of MarginGuard. Constant errors are not known: there is no
    probability of a breach (`marginguard analyse --error`).
    """
    from app.analysis import analyse_case
    from app.analysis.swept_volume import CUTTING_MM

    if not log.rows:
        return None
    content = run.prepared.content
    samples = log.samples()
    analysis = analyse_case(
        samples,
        name=content.name,
        margins=content.margins,
        tumor=content.tumor,
        tool=content.tool,
        cutting_mm=CUTTING_MM,
    )
    methods = methods_of(run.prepared, int(samples.stamps_ns[0]), program)
    return AnalysedCase(analysis, methods, content.margins, content.tumor)
