import numpy as np
import pytest

from app.geometry import FrameError
from app.registration import DriftBound, ShapeError, check_drift
from app.registration.motion import moved
from tests.registration.helpers import random_transform

BOUND = DriftBound(translation_mm=2.0, rotation_rad=np.radians(1.5))


def shifted(millimetres: float, degrees: float):
    rng = np.random.default_rng(1)
    predicted = random_transform(rng, "reference", "tip")
    direction = np.array([1.0, 2.0, -2.0]) / 3.0
    motion = np.concatenate([np.radians(degrees) * direction, millimetres * direction])
    return predicted, moved(predicted, motion, predicted.translation_mm)


@pytest.mark.parametrize(
    ("millimetres", "degrees", "accepted"),
    [(0.0, 0.0, True), (1.9, 1.4, True), (2.1, 0.0, False), (0.0, 1.6, False), (50.0, 90.0, False)],
)
def test_either_bound_is_enough_to_refuse(
    millimetres: float, degrees: float, accepted: bool
) -> None:
    drift = check_drift(*shifted(millimetres, degrees), BOUND)
    assert drift.accepted is accepted
    assert drift.translation_mm == pytest.approx(millimetres, abs=1e-9)
    assert np.degrees(drift.rotation_rad) == pytest.approx(degrees, abs=1e-6)
    assert "tip is" in drift.reason and "2 mm and 1.5 degrees allowed" in drift.reason


def test_frames_and_bounds_are_checked() -> None:
    predicted, measured = shifted(1.0, 1.0)
    with pytest.raises(FrameError):
        check_drift(predicted, measured.renamed(source="needle"), BOUND)
    for bad in (0.0, float("nan"), float("inf")):
        with pytest.raises(ShapeError, match="rotation_rad"):
            DriftBound(1.0, bad)
