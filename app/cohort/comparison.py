"""Comparison of two groups of cases: differences with intervals, tests, multiplicity; and outliers.

For each metric the difference of the means (second group minus first) has a 95 % percentile
bootstrap interval; pairs are drawn as pairs. One test is the primary one: paired t where at least
`MIN_PAIRS` pairs exist, otherwise a mixed model with a random intercept for each surgeon where
surgeons repeat, otherwise Welch's t. The p values of the primary tests of all metrics are adjusted
by Holm's method; the others are reported as they are. An outlier has an unusual value within its
group.
"""

import csv
import io
import math
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import stats

from app.cohort.columns import OK, Row
from app.geometry import FloatArray

METRICS = {
    "min_signed_distance_mm": "smallest distance (mm)",
    "breaches": "breaches",
    "breach_s": "time in breach (s)",
    "positive_s": "time in the state POSITIVE: in the tumour (s)",
    "warning_s": "time in the state WARNING (s)",
    "path_mm": "path of the tip (mm)",
    "mean_speed_mm_s": "mean speed of the tip (mm/s)",
    "tissue_damage_mm2": "tissue damage (mm2)",
    "duration_s": "duration (s)",
}
"""Column -> label of what is compared, in the order of the report."""

MIN_PAIRS = 3
MIN_SURGEONS = 3
RESAMPLES = 2000
SEED = 0
_MAX_DRAWN = 1_000_000
"""Values that are drawn at a time: bounds the memory."""
THRESHOLD = 3.5
_TO_SIGMA = 0.6745


@dataclass(frozen=True, slots=True)
class MixedModel:
    """Effect of the second group with a random intercept for each surgeon, by REML."""

    effect: float
    low: float
    high: float
    p: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """One metric in two groups; None where it cannot be computed.

    ``difference`` is second minus first, ``low`` and ``high`` its interval. ``standardized`` is
    Hedges' g: the difference over the pooled standard deviation, with the interval of the
    difference on the same scale.
    """

    metric: str
    groups: tuple[str, str]
    counts: tuple[int, int]
    means: tuple[float, float]
    deviations: tuple[float, float]
    pairs: int
    difference: float
    low: float
    high: float
    standardized: tuple[float, float, float] | None
    tests: Mapping[str, float | None]
    mixed: MixedModel | None
    primary: str
    adjusted_p: float | None

    @property
    def p(self) -> float | None:
        """P value of the primary test."""
        return self.tests[self.primary]


@dataclass(frozen=True, slots=True)
class _Sample:
    values: FloatArray
    surgeons: tuple[str, ...]
    pairs: Mapping[str, float]


def groups_of(rows: Sequence[Row]) -> tuple[str, ...]:
    """Names of the groups that have a finished case, sorted."""
    return tuple(
        sorted({str(row["group"]) for row in rows if row["status"] == OK and row["group"]})
    )


def compare(rows: Sequence[Row], groups: tuple[str, str]) -> tuple[Comparison, ...]:
    """Compare the finished cases of two groups; metrics with fewer than two values are left out."""
    found = []
    for metric in METRICS:
        first, second = (_sample(rows, group, metric) for group in groups)
        if min(len(first.values), len(second.values)) >= 2:
            found.append(_compared(metric, groups, first, second))
    adjusted = holm([comparison.p for comparison in found])
    return tuple(replace(each, adjusted_p=p) for each, p in zip(found, adjusted, strict=True))


def holm(values: Sequence[float | None]) -> list[float | None]:
    """P values adjusted by Holm's step-down method; unknown ones stay so and do not count."""
    known = sorted((p, index) for index, p in enumerate(values) if p is not None)
    adjusted: list[float | None] = [None] * len(values)
    largest = 0.0
    for rank, (p, index) in enumerate(known):
        largest = max(largest, min(1.0, (len(known) - rank) * p))
        adjusted[index] = largest
    return adjusted


def _sample(rows: Sequence[Row], group: str, metric: str) -> _Sample:
    chosen = [
        row
        for row in rows
        if row["status"] == OK and row["group"] == group and row.get(metric) is not None
    ]
    values = np.array([float(row[metric] or 0.0) for row in chosen])
    uses = Counter(str(row["pair"]) for row in chosen if row["pair"])
    pairs = {
        str(row["pair"]): float(value)
        for row, value in zip(chosen, values.tolist(), strict=True)
        if uses[str(row["pair"])] == 1
    }
    return _Sample(values, tuple(str(row["surgeon"]) for row in chosen), pairs)


def _compared(metric: str, groups: tuple[str, str], first: _Sample, second: _Sample) -> Comparison:
    shared = sorted(first.pairs.keys() & second.pairs.keys())
    before, after = (
        np.array([sample.pairs[name] for name in shared]) for sample in (first, second)
    )
    paired = len(shared) >= MIN_PAIRS
    a, b = first.values, second.values
    mixed = _mixed_model(first, second)
    tests = {
        "Welch t": _p(lambda: stats.ttest_ind(a, b, equal_var=False)),
        "Mann-Whitney U": _p(lambda: stats.mannwhitneyu(a, b)),
        "paired t": _paired_t(before, after) if paired else None,
        "Wilcoxon signed rank": _p(lambda: stats.wilcoxon(before, after)) if paired else None,
        "mixed model": None if mixed is None else mixed.p,
    }
    random = np.random.default_rng(SEED)
    if paired:
        difference = float((after - before).mean())
        resampled = _bootstrap_means(after - before, random)
        primary = "paired t"
    else:
        difference = float(b.mean() - a.mean())
        resampled = _bootstrap_means(b, random) - _bootstrap_means(a, random)
        primary = "Welch t" if mixed is None else "mixed model"
    low, high = (float(v) for v in np.percentile(resampled, (2.5, 97.5)))
    return Comparison(
        metric,
        groups,
        (len(a), len(b)),
        (float(a.mean()), float(b.mean())),
        (float(a.std(ddof=1)), float(b.std(ddof=1))),
        len(shared) if paired else 0,
        difference,
        low,
        high,
        _standardized(a, b, (difference, low, high)),
        tests,
        mixed,
        primary,
        None,
    )


def _bootstrap_means(values: FloatArray, random: np.random.Generator) -> FloatArray:
    count = len(values)
    at_once = max(1, _MAX_DRAWN // count)
    means = [
        values[random.integers(count, size=(min(at_once, RESAMPLES - first), count))].mean(axis=1)
        for first in range(0, RESAMPLES, at_once)
    ]
    return np.concatenate(means)


def _standardized(
    a: FloatArray, b: FloatArray, values: tuple[float, float, float]
) -> tuple[float, float, float] | None:
    freedom = len(a) + len(b) - 2
    pooled = math.sqrt(
        ((len(a) - 1) * float(a.var(ddof=1)) + (len(b) - 1) * float(b.var(ddof=1))) / freedom
    )
    if pooled < 1e-12:
        return None
    small = 1.0 - 3.0 / (4.0 * freedom - 1.0)
    centre, low, high = (small * value / pooled for value in values)
    return centre, low, high


def _paired_t(before: FloatArray, after: FloatArray) -> float | None:
    """None where all differences are equal but for rounding: the test has no spread to use."""
    spread = float((after - before).std())
    if spread <= 1e-12 * float(np.abs([before, after]).max()):
        return None
    return _p(lambda: stats.ttest_rel(before, after))


def _p(test: Callable[[], Any]) -> float | None:
    """The p value of a test of scipy; None where it has none: all values are equal."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            p = float(test().pvalue)
        except ValueError:
            return None
    return p if math.isfinite(p) else None


def _mixed_model(first: _Sample, second: _Sample) -> MixedModel | None:
    surgeons = (*first.surgeons, *second.surgeons)
    counts = Counter(surgeons)
    repeated = sum(count > 1 for count in counts.values())
    if "" in counts or repeated < MIN_SURGEONS:
        return None
    from statsmodels.regression.mixed_linear_model import MixedLM

    values = np.concatenate([first.values, second.values])
    if float(values.std()) < 1e-12:
        return None
    in_second = np.repeat([0.0, 1.0], [len(first.values), len(second.values)])
    design = np.stack([np.ones_like(values), in_second], axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            fit = MixedLM(values, design, groups=np.array(surgeons)).fit(reml=True)
            low, high = fit.conf_int()[1]
            numbers = [float(v) for v in (fit.params[1], low, high, fit.pvalues[1])]
        except (ValueError, np.linalg.LinAlgError):
            return None
    if not fit.converged or not all(map(math.isfinite, numbers)):
        return None
    return MixedModel(*numbers)


def comparison_csv(comparisons: Sequence[Comparison]) -> str:
    """The comparisons as CSV: one line for each metric, empty where a value is unknown."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    head = ("metric", "first", "second", "n_first", "n_second", "mean_first", "mean_second")
    tests = list(comparisons[0].tests) if comparisons else []
    writer.writerow((*head, "pairs", "difference", "low", "high", *tests, "primary", "p_holm"))
    for each in comparisons:
        numbers = (*each.means, each.pairs, each.difference, each.low, each.high)
        values = [*numbers, *each.tests.values(), each.primary, each.adjusted_p]
        writer.writerow((each.metric, *each.groups, *each.counts, *values))
    return text.getvalue()


@dataclass(frozen=True, slots=True)
class Outlier:
    """A value whose modified z score (Iglewicz and Hoaglin 1993) is beyond `THRESHOLD`."""

    row: Row
    metric: str
    value: float
    score: float


def find_outliers(rows: Sequence[Row]) -> tuple[Outlier, ...]:
    """Outliers of every metric, within each group, the largest scores first.

    The score is 0.6745 (x - median) / MAD. A metric without spread (MAD 0) has none.
    """
    found = []
    finished = [row for row in rows if row["status"] == OK]
    for group in sorted({str(row["group"]) for row in finished}):
        for metric in METRICS:
            chosen = [
                row for row in finished if row["group"] == group and row.get(metric) is not None
            ]
            values = np.array([float(row[metric] or 0.0) for row in chosen])
            if not len(values):
                continue
            off = values - np.median(values)
            spread = float(np.median(np.abs(off)))
            if spread == 0.0:
                continue
            scores = (_TO_SIGMA * off / spread).tolist()
            found += [
                Outlier(row, metric, float(value), score)
                for row, value, score in zip(chosen, values.tolist(), scores, strict=True)
                if abs(score) > THRESHOLD
            ]
    return tuple(sorted(found, key=lambda each: (-abs(each.score), str(each.row["name"]))))
