"""Patient and surgeon of a simulated case: shape, breathing, place, skill, fixture."""

import numpy as np
import pytest

from app.geometry import InputError
from app.synthetic import CaseOptions
from app.synthetic.case_options import PatientOptions, SurgeonOptions
from app.synthetic.error_budget import plan_depths
from app.synthetic.script import PLUNGE_FROM_MM, Script
from app.synthetic.tumour_and_tool import Tumour, icosphere
from tests.synthetic.test_motion import DIRECTION, height_over_floor, tip_at

DIRECTIONS, _ = icosphere(3)


def tumour():
    return Tumour.generate(np.random.default_rng(3))


def test_usual_options_change_nothing():
    before, after = tumour(), PatientOptions().shaped(tumour())
    assert np.array_equal(before.radius_mm(DIRECTIONS), after.radius_mm(DIRECTIONS))


def test_elongation_is_the_ratio_of_axes_at_the_same_volume():
    before = tumour().semi_axes_mm
    axes = PatientOptions(elongation=1.7).shaped(tumour()).semi_axes_mm
    assert axes[0] / np.sqrt(axes[1] * axes[2]) == pytest.approx(1.7)
    assert np.prod(axes) == pytest.approx(np.prod(before))
    usual = before[0] / np.sqrt(before[1] * before[2])
    same = PatientOptions(elongation=float(usual)).shaped(tumour()).semi_axes_mm
    assert same == pytest.approx(before)


def test_without_irregularity_the_tumour_is_an_ellipsoid():
    smooth = PatientOptions(irregularity=0.0).shaped(tumour())
    on_axes = smooth.radius_mm(np.eye(3))
    assert on_axes == pytest.approx(smooth.semi_axes_mm)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PatientOptions(breath_mm=30.0), "breath_mm is 30; expected 0 to 12"),
        (lambda: PatientOptions(elongation=0.5), "elongation is 0.5; expected 1 to 2"),
        (lambda: PatientOptions(x_mm=float("nan")), "x_mm is nan; expected -10 to 10"),
        (lambda: SurgeonOptions(skill=1.5), "skill is 1.5; expected 0 to 1"),
        (lambda: CaseOptions().with_values({"patient.z_mm": 11.0}), "z_mm is 11; expected"),
    ],
)
def test_value_out_of_range_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_expert_enters_less_often_than_a_novice_and_works_faster():
    random = np.random.default_rng(0)
    shares = []
    for skill in (0.0, 0.5, 1.0):
        surgeon = SurgeonOptions(skill)
        shares.append(float(np.mean([surgeon.enters(random) for _ in range(4000)])))
    assert shares == pytest.approx([1.0, 0.6, 0.2], abs=0.03)
    assert [SurgeonOptions(skill).pace for skill in (0.0, 1.0, None)] == [1.5, 1.0, 1.0]
    assert SurgeonOptions(1.0).wander(random) == (0.0, 0.0)
    assert SurgeonOptions(1.0).depth_factor(random) == 1.0
    assert 1.0 <= SurgeonOptions(0.0).depth_factor(random) <= 1.6


def test_entry_with_the_fixture_rests_before_the_surface():
    halted = Script(tip_at(0.0, 0.0, 40.0), height_over_floor)
    halted.halt(tip_at(1.0, 2.0, 4.0), DIRECTION, distance_mm=2.2, hold_s=0.3, speed_mm_s=45.0)
    path = halted.path
    times = np.linspace(0.0, path.end_s, 4001)
    heights = np.array([height_over_floor(path.at(t)) for t in times.tolist()])
    assert heights.min() == pytest.approx(2.2, abs=1e-5)
    assert heights[-1] == pytest.approx(PLUNGE_FROM_MM, abs=1e-5)
    assert np.abs(np.gradient(heights, times)[times > 1.5]).max() < 45.0
    assert np.mean(heights < 2.2 + 1e-6) * path.end_s == pytest.approx(0.3, abs=0.02)


def test_depths_leave_room_for_the_bound_of_the_error():
    depths = plan_depths(1.2, 11.0)
    assert depths.halt_mm == pytest.approx(2.2)
    assert depths.deepest_mm == pytest.approx(0.8 * 11.0)
