"""Goals and parts of `marginguard bench cohort`, on figures that are made up."""

import pytest

from benchmarks.cohort import __main__ as cohort
from benchmarks.cohort.__main__ import Run, growth_of

pytestmark = pytest.mark.slow

RUN = {
    "workers": 1, "killed": 0, "wall_s": 100.0, "cpu_s_per_case": 2.5, "case_wall_s": 2.6,
    "rss_mb": (300.0, 310.0), "growth": 0.01, "digest": "abc", "partitions": 4,
}  # fmt: skip
KILLED = RUN | {"workers": 2, "killed": 2, "wall_s": 90.0}


@pytest.fixture(autouse=True)
def two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cohort, "_processors", lambda: 2)


def missed(*runs: Run, second_s: float = 3.0, unchanged: bool = True) -> str:
    goals = cohort.goals_of([*runs, KILLED], second_s, unchanged=unchanged)
    return "; ".join(f"{goal.what} {goal.found}" for goal in goals if not goal.good)


def test_good_figures_miss_nothing():
    # Four workers on two processors may take as long as two.
    assert missed(RUN, RUN | {"workers": 2, "wall_s": 55.0}, RUN | {"workers": 4}) == ""


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"digest": "other"}, "bytes of all runs: abc other"),
        ({"growth": 0.2}, "+20.0 %"),
        ({"wall_s": 101.0}, "100 s with 1, 101 s with 2"),
    ],
)
def test_a_missed_goal_is_named(change, problem):
    second = RUN | {"workers": 2, "wall_s": 55.0} | change
    assert problem in missed(RUN, second)


def test_cost_of_a_case_and_missing_kills_are_named():
    goals = cohort.goals_of([RUN | {"cpu_s_per_case": 3.1}], 3.0, unchanged=True)
    assert [goal.found for goal in goals if not goal.good] == ["3.1 s", "0"]


def test_a_second_run_that_works_is_named():
    assert "12.0 s" in missed(RUN, second_s=12.0)
    assert "bytes equal: False" in missed(RUN, unchanged=False)


def test_growth_compares_the_quarters_after_the_first_cases():
    assert growth_of([200.0, 290.0, 300.0, 300.0, 300.0]) is None
    assert growth_of([200.0, 290.0, 300.0, 310.0, 320.0, 330.0]) == pytest.approx(0.1)
    assert growth_of([200.0, 290.0, *([300.0] * 40)]) == 0.0
    # 1 MB for each of 100 cases: the first quarter has 312 MB on average, the last one 387.
    assert growth_of([200.0, 290.0, *range(300, 400)]) == pytest.approx(75.0 / 312.0)
