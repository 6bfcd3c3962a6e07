import numpy as np
import pytest

from app.geometry import Transform
from app.synthetic import TIP_FRAME, TUMOR_FRAME, Clearance, Tumour, find_breaches, tool_mesh

RADIUS_MM = 10.0
SHAFT_MM = 1.4
DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def clearance():
    sphere = Tumour(np.full(3, RADIUS_MM), np.array([[0.0, 0.0, 1.0]]), np.zeros(1), np.ones(1))
    return Clearance(sphere, tool_mesh())


def at(x, y, z):
    return Transform(TUMOR_FRAME, TIP_FRAME, DOWN, np.array([x, y, z]))


def test_oscillating_tip_enters_and_leaves_a_sphere_at_exact_times(clearance):
    # Height of the tip: 12 + 5 cos(pi t), so inside for cos(pi t) < -2/5.
    def motion(time_s):
        return at(0.0, 0.0, 12.0 + 5.0 * np.cos(np.pi * time_s))

    first, second = find_breaches(clearance, motion, 4.0)
    enter = np.arccos(-0.4) / np.pi
    assert first.start_s == pytest.approx(enter, abs=1e-4)
    assert first.end_s == pytest.approx(2.0 - enter, abs=1e-4)
    assert second.start_s == pytest.approx(2.0 + enter, abs=1e-4)
    assert first.min_signed_distance_mm == pytest.approx(-3.0, abs=0.01)
    assert not first.shaft_only
    assert first.tip_clearance_mm == pytest.approx(-3.0, abs=0.01)


def test_grazing_shaft_is_a_breach_of_the_shaft_only(clearance):
    # The axis is 14 - 5 sin(pi t / 2) beside the centre, the tip 30 mm below it.
    def motion(time_s):
        return at(0.0, 14.0 - 5.0 * np.sin(np.pi * time_s / 2.0), -30.0)

    (breach,) = find_breaches(clearance, motion, 2.0)
    enter = 2.0 / np.pi * np.arcsin((14.0 - RADIUS_MM - SHAFT_MM) / 5.0)
    assert breach.start_s == pytest.approx(enter, abs=2e-3)
    assert breach.end_s == pytest.approx(2.0 - enter, abs=2e-3)
    assert breach.min_signed_distance_mm == pytest.approx(9.0 - SHAFT_MM - RADIUS_MM, abs=0.02)
    assert breach.shaft_only
    assert breach.tip_clearance_mm == pytest.approx(np.hypot(30.0, 9.0) - RADIUS_MM, abs=0.05)


def test_contact_of_a_few_milliseconds_is_found(clearance):
    # 400 mm/s past a point 0.05 mm inside: a contact of 5 ms, less than a tracker's period.
    def motion(time_s):
        return at(400.0 * (time_s - 0.507), 0.0, RADIUS_MM - 0.05)

    (breach,) = find_breaches(clearance, motion, 1.0)
    assert 0.502 < breach.start_s < 0.507 < breach.end_s < 0.513
    assert breach.min_signed_distance_mm == pytest.approx(-0.05, abs=0.02)


def test_a_motion_that_stays_away_has_no_breach(clearance):
    assert find_breaches(clearance, lambda t: at(20.0 * np.cos(t), 0.0, 11.0), 6.0) == ()


def test_motion_inside_is_one_breach_from_start_to_end(clearance):
    (breach,) = find_breaches(clearance, lambda t: at(0.0, 0.0, 8.0), 0.2)
    assert (breach.start_s, breach.end_s) == (0.0, 0.2)
