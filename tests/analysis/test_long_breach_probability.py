"""Probabilities of a breach over 2000 simulated cases: reliability of each tenth, Brier score."""

import math

import numpy as np
import pytest

from tests.analysis.simulated_outcomes import predictions

pytestmark = [pytest.mark.exhaustive, pytest.mark.timeout(3600)]

MAX_MISS = 0.02
"""Difference of the shares of a tenth beyond three standard deviations of chance."""


def test_probabilities_of_simulated_cases_are_calibrated():
    found = list(predictions(2000, 1))
    probabilities = np.array([each.probability for each in found])
    breaches = np.array([each.breach for each in found], dtype=float)
    tenth = np.minimum((10 * probabilities).astype(int), 9)
    for number in range(10):
        predicted, observed = probabilities[tenth == number], breaches[tenth == number]
        mean = float(predicted.mean())
        chance = math.sqrt(mean * (1.0 - mean) / len(predicted))
        assert abs(observed.mean() - mean) <= MAX_MISS + 3.0 * chance, number
    brier = np.mean((probabilities - breaches) ** 2)
    assert brier - np.mean(probabilities * (1.0 - probabilities)) <= 0.01
    assert brier < 0.5 * breaches.mean() * (1.0 - breaches.mean())
