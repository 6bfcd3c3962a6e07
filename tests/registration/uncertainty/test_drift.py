"""Drift between predicted and measured tool pose, and its bound."""

import numpy as np
import pytest

from app.geometry import Transform
from app.registration import DriftBound, RegistrationDrift, ShapeError
from app.registration.small_motion import apply_motion
from tests.registration.helpers import random_transform

BOUND = DriftBound(translation_mm=2.0, rotation_rad=np.radians(1.5))


def drift_between(predicted: Transform, measured: Transform, bound: DriftBound):
    moved_mm, turned_rad = predicted.distance_mm_to(measured), predicted.angle_to(measured)
    return RegistrationDrift(predicted.source, moved_mm, turned_rad, bound)


def shifted(millimetres: float, degrees: float) -> tuple[Transform, Transform]:
    rng = np.random.default_rng(1)
    predicted = random_transform(rng, "reference", "tip")
    direction = np.array([1.0, 2.0, -2.0]) / 3.0
    motion = np.concatenate([np.radians(degrees) * direction, millimetres * direction])
    return predicted, apply_motion(predicted, motion, predicted.translation_mm)


@pytest.mark.parametrize(
    ("millimetres", "degrees", "accepted"),
    [(0.0, 0.0, True), (1.9, 1.4, True), (2.1, 0.0, False), (0.0, 1.6, False), (50.0, 90.0, False)],
)
def test_drift_beyond_either_bound_is_not_accepted(millimetres, degrees, accepted):
    drift = drift_between(*shifted(millimetres, degrees), BOUND)
    assert drift.accepted is accepted
    assert drift.translation_mm == pytest.approx(millimetres, abs=1e-9)
    assert np.degrees(drift.rotation_rad) == pytest.approx(degrees, abs=1e-6)
    assert "tip is" in drift.reason and "expected at most 2 mm and 1.5 degrees" in drift.reason


def test_bounds_are_validated():
    for bad in (0.0, float("nan"), float("inf")):
        with pytest.raises(ShapeError, match="rotation_rad"):
            DriftBound(1.0, bad)
