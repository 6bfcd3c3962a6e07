"""Goals of `marginguard bench cohort`, on figures that are made up."""

from dataclasses import replace

import pytest

from benchmarks import cohort
from benchmarks.cohort import Run

RUN = Run(1, 0, 100.0, 10.0, 11.0, (300.0, 310.0), 0.01, "abc")
KILLED = replace(RUN, workers=2, killed=2, wall_s=90.0)


@pytest.fixture(autouse=True)
def two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cohort, "_processors", lambda: 2)


def missed(*runs: Run, second_s: float = 3.0, unchanged: bool = True) -> str:
    return "; ".join(cohort._missed([*runs, KILLED], second_s, unchanged=unchanged))


def test_good_figures_miss_nothing():
    # Four workers on two processors may take as long as two.
    assert missed(RUN, replace(RUN, workers=2, wall_s=55.0), replace(RUN, workers=4)) == ""


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"digest": "other"}, "bytes differ"),
        ({"growth": 0.2}, "grew by 20.0 %"),
        ({"wall_s": 101.0}, "2 workers took longer than 1"),
    ],
)
def test_a_missed_goal_is_named(change, problem):
    second = replace(RUN, **({"workers": 2, "wall_s": 55.0} | change))
    assert problem in missed(RUN, second)


def test_a_second_run_that_works_is_named():
    assert "second run took 12.0 s" in missed(RUN, second_s=12.0)
    assert "bytes equal: False" in missed(RUN, unchanged=False)


def test_growth_compares_the_halves_after_the_first_cases():
    assert cohort._growth([200.0, 290.0, 300.0]) is None
    assert cohort._growth([200.0, 290.0, 300.0, 300.0, 330.0, 330.0]) == pytest.approx(0.1)
    assert cohort._growth([200.0, 290.0, 300.0, 301.0]) < 0.01
