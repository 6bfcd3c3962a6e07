"""Statistics of two groups: against scipy, by simulation, and at the edges."""

import numpy as np
import pytest
from scipy import stats

from app.cohort import CohortCase, compare, comparison_csv, find_outliers, groups_of, identity_of
from app.cohort.columns import FAILED, OK
from app.cohort.comparison import holm


def row(index, group, surgeon="", pair="", status=OK, **values):
    case = CohortCase(f"case_{index}", f"/cases/{index}", group=group, surgeon=surgeon, pair=pair)
    return identity_of(case, "h", "1") | {"status": status} | values


def rows_of(first, second, *, paired=False, surgeons=None, metric="path_mm"):
    made = []
    for group, values in (("off", first), ("on", second)):
        for index, value in enumerate(values):
            surgeon = "" if surgeons is None else f"s{surgeons[index]}"
            pair = f"p{index}" if paired else ""
            made.append(row(len(made), group, surgeon, pair, **{metric: float(value)}))
    return made


RANDOM = np.random.default_rng(3)
FIRST = RANDOM.normal(100.0, 10.0, 30)
SECOND = FIRST - 4.0 + RANDOM.normal(0.0, 3.0, 30)


def only(rows):
    (comparison,) = compare(rows, ("off", "on"))
    return comparison


def test_unpaired_groups_are_compared_by_welch():
    found = only(rows_of(FIRST, SECOND[:20]))
    assert found.primary == "Welch t" and found.pairs == 0 and found.counts == (30, 20)
    assert found.p == pytest.approx(stats.ttest_ind(FIRST, SECOND[:20], equal_var=False).pvalue)
    assert found.tests["Mann-Whitney U"] == stats.mannwhitneyu(FIRST, SECOND[:20]).pvalue
    assert found.tests["paired t"] is None and found.mixed is None
    assert found.difference == pytest.approx(SECOND[:20].mean() - FIRST.mean())


def test_pairs_are_compared_as_pairs_whatever_their_order():
    rows = rows_of(FIRST, SECOND, paired=True)
    found = only(rows)
    assert found.primary == "paired t" and found.pairs == 30
    assert found.p == pytest.approx(stats.ttest_rel(FIRST, SECOND).pvalue)
    assert found.tests["Wilcoxon signed rank"] == stats.wilcoxon(FIRST, SECOND).pvalue
    half = 1.96 * (SECOND - FIRST).std(ddof=1) / np.sqrt(30)
    assert (found.high - found.low) / 2 == pytest.approx(half, rel=0.15)
    assert only(rows[::-1]).difference == pytest.approx(found.difference)


def test_interval_of_the_bootstrap_covers_the_truth_as_often_as_it_states():
    covered = 0
    for seed in range(150):
        random = np.random.default_rng(seed)
        found = only(rows_of(random.normal(0, 1, 40), random.normal(0.5, 2, 40)))
        covered += found.low <= 0.5 <= found.high
    assert 0.88 <= covered / 150 <= 0.99


def test_mixed_model_takes_out_the_surgeon():
    random = np.random.default_rng(8)
    surgeons = np.arange(60) % 6
    level = random.normal(0.0, 30.0, 6)[surgeons]
    first = 100.0 + level + random.normal(0, 2, 60)
    second = 103.0 + level + random.normal(0, 2, 60)
    found = only(rows_of(first, second, surgeons=surgeons))
    assert found.primary == "mixed model" and found.mixed is not None
    assert found.mixed.low < 3.0 < found.mixed.high and found.mixed.p < 1e-6
    # Balanced surgeons: the effect is the difference of the means, with the error within surgeons.
    assert found.mixed.effect == pytest.approx(found.difference, abs=1e-6)
    width = 2 * 1.96 * 2 * np.sqrt(2 / 60)
    assert found.mixed.high - found.mixed.low == pytest.approx(width, rel=0.2)
    assert found.tests["Welch t"] > 0.05


def test_holm_adjusts_in_steps_and_leaves_out_the_unknown():
    assert holm([0.01, 0.04, None, 0.03]) == pytest.approx([0.03, 0.06, None, 0.06])
    assert holm([0.9, 0.8]) == [1.0, 1.0] and holm([None]) == [None]


def test_all_metrics_are_adjusted_together():
    rows = [
        each | {"duration_s": 50.0 + index % 7, "breaches": index % 3}
        for index, each in enumerate(rows_of(FIRST, SECOND))
    ]
    found = {each.metric: each for each in compare(rows, ("off", "on"))}
    assert set(found) == {"breaches", "path_mm", "duration_s"}
    adjusted = holm([each.p for each in found.values()])
    assert [each.adjusted_p for each in found.values()] == adjusted


def test_groups_without_spread_have_no_p_value_and_no_standardized_difference():
    found = only(rows_of([3.0] * 4, [0.0] * 4, metric="breaches"))
    assert found.difference == found.low == found.high == -3.0
    assert found.standardized is None
    same = only(rows_of([3.0] * 4, [3.0] * 4, paired=True, metric="breaches"))
    assert same.p is None and same.adjusted_p is None


def test_pairs_that_differ_by_a_constant_have_no_p_value_of_the_t_test():
    """The differences have the spread of rounding only, which would give 1e-78."""
    first = [0.3 * k for k in range(6)]
    found = only(rows_of(first, [value + 0.1 for value in first], paired=True))
    assert found.tests["paired t"] is None
    assert found.tests["Wilcoxon signed rank"] == pytest.approx(2 / 2**6)


def test_failed_cases_and_unknown_values_are_left_out():
    rows = rows_of(FIRST, SECOND)
    rows += [row(98, "off", status=FAILED), row(99, "third", status=FAILED, path_mm=1.0)]
    assert groups_of(rows) == ("off", "on") and only(rows) == only(rows[:60])
    assert compare(rows_of([1.0], [2.0, 3.0]), ("off", "on")) == ()


def test_csv_has_a_line_for_each_metric():
    lines = comparison_csv(compare(rows_of(FIRST, SECOND), ("off", "on"))).splitlines()
    assert len(lines) == 2 and lines[0].startswith("metric,first,second,n_first")
    assert len(lines[0].split(",")) == len(lines[1].split(","))
    assert lines[1].startswith("path_mm,off,on,30,30,")


def test_outlier_is_found_within_its_group():
    rows = rows_of([*FIRST, 300.0], SECOND)
    found = find_outliers(rows)[0]
    assert found.row["name"] == "case_30" and found.metric == "path_mm" and found.score > 10.0
    assert find_outliers(rows_of([3.0] * 9 + [0.0], [3.0] * 9, metric="breaches")) == ()
