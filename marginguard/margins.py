"""The margin of a replay: table, breaches, plot."""

from collections.abc import Iterable
from io import StringIO
from typing import TYPE_CHECKING

from app import analysis, report
from app.analysis import Breach
from app.fixture import MarginParameters, MarginState, Reason
from app.geometry import InputError
from app.report import ReportRow
from app.runtime import PreparedCase
from app.session import StepResult
from marginguard.values import checked, checked_list, needs

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

__all__ = [
    "Breach",
    "MarginParameters",
    "MarginState",
    "Reason",
    "find_breaches",
    "margin_table",
    "plot_margin",
]

_STEPS = ", as replay yields"
_CASE = ", as open_case returns"


def margin_table(steps: Iterable[StepResult]) -> "DataFrame":
    """One row per step, with the columns and values of ``margin.csv`` (``docs/report.md``).

    An unknown number is NaN; reasons are joined by ``;``, worst first. Needs pandas, of the extra
    ``notebook``. Raises `InputError` without it, without steps, and for other values.

    >>> import marginguard as mg
    >>> case = mg.open_case(mg.example_case())
    >>> table = mg.margin_table(mg.replay(case, start_s=95.0, end_s=97.0))
    >>> table["state"].unique().tolist()
    ['NEGATIVE', 'WARNING', 'POSITIVE']
    """
    with needs("pandas"):
        import pandas
    text = report.margin_csv(_rows(steps))
    return pandas.read_csv(StringIO(text), keep_default_na=False, na_values=[""])


def find_breaches(case: PreparedCase, steps: Iterable[StepResult]) -> tuple[Breach, ...]:
    """The intervals of ``steps`` in which the tool is in the tumour, in the order of time.

    The state has hysteresis; a breach has none. Raises `InputError` for other values.

    >>> import marginguard as mg
    >>> case = mg.open_case(mg.example_case())
    >>> breaches = mg.find_breaches(case, mg.replay(case, start_s=95.0, end_s=137.0))
    >>> [round(breach.min_signed_distance_mm, 1) for breach in breaches]
    [-4.9, -2.7]
    """
    checked(case, PreparedCase, "case", _CASE)
    return analysis.find_breaches(_rows(steps), case.setup.margins.stale_after_ns)


def plot_margin(case: PreparedCase, steps: Iterable[StepResult]) -> "Figure":
    """The signed distance over time, with states and breaches: ``margin.png`` of a report.

    Returns a figure of matplotlib; ``figure.savefig(path)`` writes it. Uses neither pyplot nor a
    screen. Raises `InputError` for other values.

    >>> import marginguard as mg
    >>> case = mg.open_case(mg.example_case())
    >>> figure = mg.plot_margin(case, mg.replay(case, start_s=90.0, end_s=100.0))
    >>> figure.axes[1].get_ylabel()
    'signed distance, tool to tumour [mm]'
    """
    from app.report.margin_plot import margin_figure

    checked(case, PreparedCase, "case", _CASE)
    rows, margins = _rows(steps), case.setup.margins
    breaches = analysis.find_breaches(rows, margins.stale_after_ns)
    return margin_figure(rows, breaches, margins, case.case.manifest.name)


def _rows(steps: Iterable[StepResult]) -> list[ReportRow]:
    found = checked_list(steps, StepResult, "steps", _STEPS)
    if not found:
        raise InputError("steps: there are 0; expected at least 1")
    return [ReportRow.from_step(step) for step in found]
