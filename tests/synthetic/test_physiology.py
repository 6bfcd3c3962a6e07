import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry import Transform
from app.synthetic.physiology import Breathing, BreathingBody

BREATHING = Breathing(held_until_s=18.0)


@given(st.floats(0.0, 18.0))
def test_held_breath_has_depth_zero(time_s):
    assert BREATHING.depth(time_s) == 0.0


@given(st.floats(18.0, 200.0))
def test_a_breath_takes_four_seconds_and_stays_between_its_ends(time_s):
    assert 0.0 <= BREATHING.depth(time_s) <= 1.0
    assert BREATHING.depth(time_s + 4.0) == pytest.approx(BREATHING.depth(time_s), abs=1e-9)


def test_inspiration_is_full_half_way_and_most_time_is_spent_near_expiration():
    assert BREATHING.depth(20.0) == pytest.approx(1.0)
    depths = [BREATHING.depth(time_s) for time_s in np.linspace(18.0, 22.0, 401)]
    assert np.mean(np.array(depths) < 0.25) > 0.45


def test_body_is_displaced_and_rotated_about_its_origin():
    rest = Transform.from_rotation_vector(
        (0.0, 0.0, 1.0), (10.0, 20.0, 30.0), target="tracker", source="needle"
    )
    body = BreathingBody(rest, np.array([0.0, 2.0, 4.0]), np.array([0.02, 0.0, 0.0]))
    np.testing.assert_allclose(body.at(0.0).matrix, rest.matrix, atol=1e-15)
    half = body.at(0.5)
    np.testing.assert_allclose(half.translation_mm, (10.0, 21.0, 32.0))
    assert rest.angle_to(half) == pytest.approx(0.01)
    np.testing.assert_allclose(half.rotate((1.0, 0.0, 0.0)), rest.rotate((1.0, 0.0, 0.0)))
