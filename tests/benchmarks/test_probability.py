"""`marginguard bench probability`: its bins and scores, its independent truth, its diagram."""

import math

import numpy as np
import pytest

from benchmarks import probability
from benchmarks.probability import Prediction, bins_of, figures, predictions


def predicted(count: int, share: float, probability: float) -> list[Prediction]:
    return [Prediction(probability, number < share * count) for number in range(count)]


def test_bins_have_the_shares_of_their_cases():
    found = predicted(100, 0.2, 0.25) + predicted(40, 1.0, 1.0)
    low, high = bins_of(found)
    assert (low.cases, low.predicted, low.observed) == (100, 0.25, pytest.approx(0.2))
    assert low.spread == pytest.approx(math.sqrt(0.25 * 0.75 / 100))
    assert (high.cases, high.predicted, high.observed) == (40, 1.0, 1.0)
    assert low.is_calibrated and high.is_calibrated
    (off,) = bins_of(predicted(100, 0.45, 0.25))
    assert not off.is_calibrated


def test_brier_scores_of_known_predictions():
    found = figures(predicted(100, 0.25, 0.25))
    assert found["Brier score"] == pytest.approx(0.25 * 0.75)
    assert found["Brier score if calibrated"] == pytest.approx(0.25 * 0.75)
    assert found["Brier score of the share of breaches"] == pytest.approx(0.25 * 0.75)


def test_without_errors_the_prediction_is_the_truth(monkeypatch):
    """The engine on the mesh and the radius function agree where nothing is off."""
    monkeypatch.setattr(probability, "JITTER_MM", 0.0)
    monkeypatch.setattr(probability, "ERROR_SCALE", 0.02)
    found = list(predictions(30, 3))
    assert 5 < sum(each.breach for each in found) < 25
    sure = [each for each in found if each.probability in (0.0, 1.0)]
    assert len(sure) >= 24
    assert all(each.breach == (each.probability == 1.0) for each in sure)


def test_diagram_is_the_same_at_each_run(tmp_path):
    from benchmarks.probability_plot import write_plot

    found = [
        Prediction(float(p), bool(p > 0.5)) for p in np.random.default_rng(1).uniform(size=200)
    ]
    for name in ("a.svg", "b.svg"):
        write_plot(tmp_path / name, bins_of(found), figures(found))
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    assert "200 simulated cases" in (tmp_path / "a.svg").read_text()
