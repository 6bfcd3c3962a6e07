"""Volume, size, shift and overlap of a replaced tumour, against closed forms of balls."""

import math

import numpy as np
import pytest
import trimesh

from app.geometry import FrameError, SurfaceMesh
from app.session import tumor_change


def ball(radius_mm, x_mm=0.0, frame="needle"):
    mesh = trimesh.creation.icosphere(4, radius=radius_mm)
    return SurfaceMesh(frame, mesh.vertices + np.array([x_mm, 0.0, 0.0]), mesh.faces)


@pytest.mark.parametrize("shift_mm", [0.0, 5.0, 10.0, 18.0])
def test_overlap_of_two_balls_is_that_of_their_lens(shift_mm):
    change = tumor_change(ball(10.0), ball(10.0, shift_mm))
    share = shift_mm / 20.0
    assert change.overlap == pytest.approx(1.0 - 1.5 * share + 0.5 * share**3, abs=0.02)
    assert change.shift_mm == pytest.approx(shift_mm, abs=1e-6)
    assert change.warnings == ()


def test_ball_of_1_mm_in_the_former_tumour_is_named_for_its_volume():
    change = tumor_change(ball(10.0), ball(0.6, 2.0))
    assert change.overlap == 1.0
    assert change.volumes_mm3[0] == pytest.approx(4.0 / 3.0 * math.pi * 1000.0, rel=0.01)
    assert change.volume_factor == pytest.approx((10.0 / 0.6) ** 3, rel=1e-6)
    np.testing.assert_allclose(change.sizes_mm[1], 1.2, atol=1e-6)
    assert change.text.startswith("tumour replaced: THE VOLUME DIFFERS BY MORE THAN A FACTOR OF 2;")
    assert "bounding box from 20.0 x 20.0 x 20.0 to 1.2 x 1.2 x 1.2 mm" in change.text


@pytest.mark.parametrize("x_mm", [20.5, 30.0, 211.0])
def test_tumour_elsewhere_is_named_for_its_overlap(x_mm):
    change = tumor_change(ball(10.0), ball(10.0, x_mm))
    assert change.overlap == 0.0
    assert change.warnings == ("IT DOES NOT OVERLAP THE FORMER TUMOUR",)


def test_tumours_in_different_frames_are_refused():
    with pytest.raises(FrameError, match="expected one frame"):
        tumor_change(ball(1.0), ball(1.0, frame="reference"))
