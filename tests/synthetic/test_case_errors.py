"""Errors of a case: contour, calibrations, encoders, and what they demand of the plan."""

from dataclasses import replace

import numpy as np
import pytest

from app.geometry import Transform
from app.synthetic.case_options import (
    CaseErrors,
    CaseOptions,
    Encoders,
    contoured,
    offset_ns,
    typical_errors,
    wrong_pose,
)
from app.synthetic.error_budget import margin_bound_mm, plan_depths, tolerances
from app.synthetic.tumour_and_tool import Tumour, icosphere
from tests.refusals import refused

DIRECTIONS, _ = icosphere(5)


@pytest.fixture(scope="module")
def tumour():
    return Tumour.generate(np.random.default_rng(4)).with_diameter(14.0)


def test_diameter_is_the_largest_one(tumour):
    points = tumour.surface_mm(DIRECTIONS)
    across = np.linalg.norm(points - tumour.surface_mm(-DIRECTIONS), axis=1)
    assert across.max() == pytest.approx(14.0, abs=0.05)
    assert tumour.min_radius_mm == pytest.approx(np.linalg.norm(points, axis=1).min(), abs=0.05)


def test_contour_differs_smoothly_with_the_stated_rms(tumour):
    drawn, largest_mm = contoured(tumour, 0.5, np.random.default_rng(1))
    off = drawn.radius_mm(DIRECTIONS) - tumour.radius_mm(DIRECTIONS)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(0.5, rel=0.02)
    assert np.abs(off).max() == pytest.approx(largest_mm, rel=0.03)
    assert off.min() < 0.0 < off.max()
    # Smooth: half a degree aside the error is nearly the same.
    aside = DIRECTIONS + 0.01 * np.roll(DIRECTIONS, 1, axis=1)
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    change = drawn.radius_mm(aside) - tumour.radius_mm(aside) - off
    assert np.abs(change).max() < 0.1


def test_no_contour_error_leaves_the_tumour(tumour):
    assert contoured(tumour, 0.0, np.random.default_rng(1)) == (tumour, 0.0)


def test_calibration_error_has_the_stated_length_and_angle():
    pose = Transform.from_rotation_vector((0.1, 0.2, 0.3), (1.0, 2.0, 3.0), target="a", source="b")
    wrong = wrong_pose(pose, 0.4, 0.01, np.random.default_rng(2))
    assert pose.distance_mm_to(wrong) == pytest.approx(0.4)
    assert pose.angle_to(wrong) == pytest.approx(0.01)


def test_encoders_report_steps_with_a_constant_offset():
    errors = CaseErrors(encoder_step_rad=0.001, encoder_offset_rad=0.005)
    encoders = Encoders(errors, 3, np.random.default_rng(1))
    true = np.linspace(-1.0, 1.0, 300).reshape(-1, 3)
    off = np.array([encoders.read(row) - row for row in true])
    assert np.abs(np.abs(off.mean(axis=0)) - 0.005).max() < 0.0002
    assert np.ptp(off, axis=0).max() == pytest.approx(0.001, rel=0.1)


def test_offset_of_the_clocks_includes_latency_and_error():
    options = CaseOptions.of_tracker("polaris")
    assert offset_ns(37_400_000, options) == 37_400_000 + 14_200_000 + 2_000_000
    assert offset_ns(37_400_000, CaseOptions()) == 37_400_000


@pytest.mark.parametrize("tracker", ["aurora", "trakstar", "polaris"])
@pytest.mark.parametrize("tumor_mm", [8.0, 14.0, 20.0])
def test_every_breach_is_deeper_than_the_error_can_hide(tracker, tumor_mm):
    options = CaseOptions.of_tracker(tracker, tumor_mm)
    shape = Tumour.generate(np.random.default_rng(1)).with_diameter(tumor_mm)
    bound_mm = margin_bound_mm(options, 3.0 * options.errors.contour_mm, 31.0 + tumor_mm / 2.0)
    depths = plan_depths(bound_mm, shape.min_radius_mm)
    assert bound_mm < depths.brief_mm <= depths.shaft_mm <= depths.deep_mm
    assert depths.deep_mm < shape.min_radius_mm and depths.nearest_mm > bound_mm + 1.0


def test_bound_is_three_sigma_of_independent_noise():
    bound_mm = margin_bound_mm(CaseOptions(), 0.0, 46.0)
    random, turn_rad = np.random.default_rng(3), np.deg2rad(0.3) / np.sqrt(3.0)
    along = random.normal(scale=0.3 / np.sqrt(3.0), size=(2, 100_000)).sum(axis=0)
    along += random.normal(scale=turn_rad * 46.0, size=100_000)
    along += random.normal(scale=turn_rad * 70.0, size=100_000)
    assert bound_mm == pytest.approx(3.0 * along.std(), rel=0.02)


def test_tolerances_grow_with_the_errors():
    landmarks = np.array(
        [[185.0 + x, y, 90.0 + z] for x in (-40, 40) for y in (-40, 40) for z in (-30, 30)]
    )
    pose = Transform.from_rotation_vector(
        (0.0, 0.3, 0.0), (-240.0, -120.0, -100.0), target="reference", source="base"
    )
    exact, usual = (
        tolerances(options, margin_bound_mm(options, 0.0, 40.0), landmarks, pose, 45.0)
        for options in (CaseOptions(), CaseOptions.of_tracker("aurora"))
    )
    assert exact.breach_ms == 40.0 and exact.depth_mm == 1.25
    assert usual.registration_mm > exact.registration_mm and usual.breach_ms > exact.breach_ms


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CaseOptions(duration_s=49.0), "duration is 49 s; expected 50 to 5400 s"),
        (lambda: CaseOptions(tumor_mm=5.0), "tumour is 5 mm; expected 8 to 40 mm"),
        (lambda: CaseOptions().with_values({"tracker.rate_hz": 10.0}),
         "rate is 10 Hz; expected 20"),
        (lambda: CaseOptions.of_tracker("radar"), "tracker 'radar' is not known"),
        (lambda: CaseErrors(tip_mm=-1.0), "tip_mm is -1; expected 0 to 3"),
        (lambda: replace(typical_errors(None), clock_s=float("nan")), "clock_s is nan"),
        (lambda: plan_depths(2.5, 3.0),
         "move the margin by up to 2.50 mm; expected 2.10 mm or less"),
    ],
)  # fmt: skip
def test_bad_options_are_refused_in_one_line(make, message):
    with refused(message):
        make()
