"""Pushes of a simulated hand: stopped by the fixture in physics, and not without it."""

import json

import pytest

from benchmarks.guided import main
from benchmarks.push_simulation import MARGINS


def test_fixture_stops_the_push_and_a_push_without_it_breaches(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--pushes", "1", "--seed", "3", "--json"]) == 0
    without, guided = json.loads(capsys.readouterr().out)
    assert (without["fixture"], guided["fixture"]) == (False, True)
    assert without["lowest_mm"] < 0.0
    assert MARGINS.stop_mm <= guided["lowest_mm"] < 6.0
    assert guided["stops"] == 0
    assert guided["retreat_mm_s"] == pytest.approx(without["retreat_mm_s"], rel=0.05)
