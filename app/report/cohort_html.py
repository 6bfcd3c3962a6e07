"""``report.html`` of a cohort: groups, comparison, outliers, failures; one file, no script."""

import base64
from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from app.cohort import METRICS, Comparison, Outlier
from app.cohort.columns import OK, Row
from app.report.page import NOT_A_DEVICE, document, scrolling

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
    forest_png: bytes | None,
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
    body = [
        f"<h1>{escape(name)}</h1>",
        f'<p class="device">{escape(NOT_A_DEVICE)}</p>',
        '<ul class="tiles">',
        *(f"<li><b>{escape(big)}</b>{escape(small)}</li>" for big, small in tiles),
        "</ul>",
        f'<p class="note">Measured: {measured}.</p>',
        *_comparison(comparisons, forest_png),
        *_outliers(outliers),
        *_failures(others),
        f'<p class="note">Made by MarginGuard {escape(version)} from the dataset in the folder '
        "cases beside this page.</p>",
    ]
    return document(f"{name}: cohort report", body)


def _comparison(comparisons: Sequence[Comparison], forest_png: bytes | None) -> Iterable[str]:
    if not comparisons:
        yield '<p class="note">No comparison: it needs two groups of two cases each.</p>'
        return
    first, second = comparisons[0].groups
    yield f"<h2>{escape(second)} against {escape(first)}</h2>"
    if forest_png is not None:
        data = base64.b64encode(forest_png).decode("ascii")
        label = "Forest plot of the differences"
        image = f'<img alt="{label}" src="data:image/png;base64,{data}">'
        yield scrolling(image, label, "figure")
    yield _table(
        "Comparison",
        ("metric", first, second, "difference, 95 %", "pairs", "primary test", "p", "p, Holm"),
        (
            (
                METRICS[c.metric],
                f"{c.means[0]:.4g} ± {c.deviations[0]:.3g} (n {c.counts[0]})",
                f"{c.means[1]:.4g} ± {c.deviations[1]:.3g} (n {c.counts[1]})",
                f"{c.difference:+.4g} [{c.low:.4g}, {c.high:.4g}]",
                str(c.pairs or "none"),
                c.primary,
                p_text(c.p),
                p_text(c.adjusted_p),
            )
            for c in comparisons
        ),
    )
    yield "<h2>Other tests, not adjusted</h2>"
    names = tuple(comparisons[0].tests)
    yield _table(
        "Other tests",
        ("metric", *(f"p, {name}" for name in names), "mixed model, effect of the group, 95 %"),
        (
            (METRICS[c.metric], *(p_text(c.tests[name]) for name in names), _effect(c))
            for c in comparisons
        ),
    )
    yield f'<p class="note">{escape(" ".join(_METHODS.split()))}</p>'


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


def _outliers(outliers: Sequence[Outlier]) -> Iterable[str]:
    yield f"<h2>Outliers ({len(outliers)})</h2>"
    yield (
        '<p class="note">Modified z score beyond 3.5 within the group, by median and median '
        "absolute deviation.</p>"
    )
    if outliers:
        head = (
            "<th>case</th><th>group</th><th>metric</th>"
            '<th class="number">value</th><th class="number">score</th>'
        )
        lines = (
            f"<td>{_link(each.row)}</td><td>{escape(str(each.row['group']))}</td>"
            f"<td>{escape(METRICS[each.metric])}</td>"
            f'<td class="number">{each.value:.4g}</td><td class="number">{each.score:+.1f}</td>'
            for each in outliers[:MAX_LISTED]
        )
        yield _wide("Outliers", head, lines)


def _failures(rows: Sequence[Row]) -> Iterable[str]:
    yield f"<h2>Cases with an error ({len(rows)})</h2>"
    if rows:
        lines = (
            f"<td>{_link(row)}</td><td>{escape(str(row['status']))}</td>"
            f"<td>{escape(str(row['reason']))}</td>"
            for row in rows[:MAX_LISTED]
        )
        yield _wide("Cases with an error", "<th>case</th><th>status</th><th>reason</th>", lines)


def _link(row: Row) -> str:
    """The name of a case as a link to its folder; a simulated one names what makes it."""
    name, source = escape(str(row["name"])), str(row["source"] or "")
    if not source:
        return f"{name}<br><small>make-case --case {name}</small>"
    if source.startswith(("http://", "https://", "file://")):
        url = source
    elif "://" in source:
        return f"{name}<br><small>{escape(source)}</small>"
    else:
        url = Path(source).absolute().as_uri()
    return f'<a href="{escape(url, quote=True)}">{name}</a>'


def _table(label: str, head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    return _wide(
        label,
        "".join(f"<th>{escape(cell)}</th>" for cell in head),
        ("".join(f"<td>{escape(cell)}</td>" for cell in line) for line in lines),
    )


def _wide(label: str, head: str, lines: Iterable[str]) -> str:
    """A table of cells that are HTML."""
    rows = "".join(f"<tr>{line}</tr>" for line in (head, *lines))
    return scrolling(f"<table>{rows}</table>", label)
