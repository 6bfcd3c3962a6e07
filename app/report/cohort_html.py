"""``report.html`` of a cohort: groups, comparison, outliers, failures; one file, no script."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from app.cohort import METRICS, Comparison, Outlier
from app.cohort.columns import OK, Row
from app.report.page import EFFECT, INK, document

_DPI = 120
MAX_LISTED = 200
"""Rows of the tables of outliers and failures; the dataset has all."""

_METHODS = """Every value is of one case. The difference of the means is the second group minus the
first, with a 95 % percentile bootstrap interval (2000 resamples, fixed seed; pairs are resampled as
pairs). The primary test is the paired t test where pairs exist, otherwise a linear mixed model with
a random intercept for each surgeon (REML, Wald test) where surgeons repeat, otherwise Welch's t
test. Its p values are adjusted over all metrics of this page by Holm's method; the other p values
are not adjusted and serve to judge how much the result depends on the test."""


def cohort_html(
    name: str,
    rows: Sequence[Row],
    comparisons: Sequence[Comparison],
    outliers: Sequence[Outlier],
    forest: bytes | None,
    version: str,
) -> str:
    """Return the page; every value is escaped. ``comparisons`` is empty without two groups."""
    finished = [row for row in rows if row["status"] == OK]
    others = [row for row in rows if row["status"] != OK]
    groups = Counter(str(row["group"]) or "no group" for row in finished)
    tiles = [
        (str(len(rows)), "cases"),
        (str(len(finished)), "analysed"),
        (str(len(others)), "with an error"),
        *((str(count), group) for group, count in sorted(groups.items())),
    ]
    tips = any(row["tip_only"] for row in rows)  # of all cases or of none
    measured = "the tip alone (--tip-only)" if tips else "the whole mesh of the tool"
    names = tuple(comparisons[0].tests) if comparisons else ()
    return document(
        "cohort.html",
        f"{name}: cohort report",
        name=name,
        tiles=tiles,
        measured=measured,
        groups=comparisons[0].groups if comparisons else (),
        forest_png=forest,
        comparisons=[_compared(each) for each in comparisons],
        test_header=(
            "metric",
            *(f"p, {each}" for each in names),
            "mixed model, effect of the group, 95 %",
        ),
        tests=[
            (METRICS[c.metric], *(p_text(c.tests[each]) for each in names), _effect(c))
            for c in comparisons
        ],
        methods=" ".join(_METHODS.split()),
        outlier_count=len(outliers),
        outliers=[
            (each.row, METRICS[each.metric], f"{each.value:.4g}", f"{each.score:+.1f}")
            for each in outliers[:MAX_LISTED]
        ],
        failure_count=len(others),
        failures=others[:MAX_LISTED],
        case_url=case_url,
        version=version,
    )


def _compared(c: Comparison) -> Sequence[str]:
    return (
        METRICS[c.metric],
        f"{c.means[0]:.4g} ± {c.deviations[0]:.3g} (n {c.counts[0]})",
        f"{c.means[1]:.4g} ± {c.deviations[1]:.3g} (n {c.counts[1]})",
        f"{c.difference:+.4g} [{c.low:.4g}, {c.high:.4g}]",
        str(c.pairs or "none"),
        c.primary,
        p_text(c.p),
        p_text(c.adjusted_p),
    )


def _effect(comparison: Comparison) -> str:
    mixed = comparison.mixed
    if mixed is None:
        return "none: too few repeated surgeons, no spread, or no convergence"
    return f"{mixed.effect:+.4g} [{mixed.low:.4g}, {mixed.high:.4g}]"


def p_text(p: float | None) -> str:
    """A p value for people."""
    if p is None:
        return "not defined"
    return "below 0.0001" if p < 0.0001 else f"{p:.4f}"


def case_url(row: Row) -> str:
    """The address of a case's folder; empty where it has none, as a simulated one."""
    source = str(row["source"] or "")
    if source.startswith(("http://", "https://", "file://")):
        return source
    return "" if not source or "://" in source else Path(source).absolute().as_uri()


def forest_png(comparisons: Sequence[Comparison]) -> bytes | None:
    """Draw the plot as PNG; None if no metric has a spread."""
    shown = [(c, c.standardized) for c in comparisons if c.standardized is not None]
    if not shown:
        return None
    from matplotlib.figure import Figure  # slow to load

    from app.report.margin_plot import figure_png

    figure = Figure(figsize=(13.0, 1.4 + 0.42 * len(shown)), dpi=_DPI, layout="constrained")
    plot = figure.subplots()
    for place, (comparison, (centre, low, high)) in enumerate(shown):
        plot.plot([low, high], [place, place], color=EFFECT, linewidth=2.0)
        plot.plot([centre], [place], marker="s", markersize=7, color=EFFECT)
        plot.annotate(
            f"{comparison.difference:+.3g} [{comparison.low:.3g}, {comparison.high:.3g}]",
            (1.01, place),
            xycoords=("axes fraction", "data"),
            va="center",
            color=INK,
        )
    plot.axvline(0.0, color=INK, linewidth=0.8)
    plot.set_yticks(range(len(shown)), [METRICS[c.metric] for c, _ in shown], color=INK)
    plot.set_ylim(len(shown) - 0.5, -0.5)
    first, second = shown[0][0].groups
    plot.set_xlabel(
        f"{second} minus {first}, in pooled standard deviations (Hedges' g), 95 % interval; "
        "right: in the metric's unit",
        color=INK,
        parse_math=False,
    )
    for side in ("top", "right", "left"):
        plot.spines[side].set_visible(False)
    plot.tick_params(axis="y", length=0)
    return figure_png(figure)
