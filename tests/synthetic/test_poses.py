import numpy as np
import pytest

from app.geometry import FrameError, Transform
from app.synthetic.poses import Poses
from app.synthetic.simulation import HANDLE_END_MM, TRACKED_FRAMES


def turned(target, source, seed):
    random = np.random.default_rng(seed)
    return [
        Transform.from_rotation_vector(
            random.normal(size=3), 50.0 * random.normal(size=3), target=target, source=source
        )
        for _ in range(40)
    ]


def assert_same(poses, transforms):
    assert (poses.target, poses.source) == (transforms[0].target, transforms[0].source)
    for found, expected in zip(poses.transforms(), transforms, strict=True):
        np.testing.assert_allclose(found.matrix, expected.matrix, rtol=0.0, atol=1e-12)


def test_operations_are_those_of_single_transforms():
    a_from_b, b_from_c = turned("a", "b", 1), turned("b", "c", 2)
    one, other = Poses.of(a_from_b), Poses.of(b_from_c)
    assert_same(
        one @ other, [first @ second for first, second in zip(a_from_b, b_from_c, strict=True)]
    )
    assert_same(Poses.of(a_from_b[:1]) @ other, [a_from_b[0] @ each for each in b_from_c])
    assert_same(one.inverse(), [each.inverse() for each in a_from_b])
    points = np.arange(6.0).reshape(2, 3)
    np.testing.assert_allclose(one.apply(points), [each.apply(points) for each in a_from_b])
    with pytest.raises(FrameError, match="a_from_b cannot be multiplied by a_from_b"):
        one @ one


def test_poses_of_a_simulation_at_many_times_are_those_at_each(simulation):
    times_s = np.concatenate([[-1.0, 0.0], np.linspace(0.3, simulation.duration_s + 1.0, 60)])
    single = times_s.tolist()
    tips = [simulation.tumor_from_tip(time_s) for time_s in single]
    assert_same(simulation.tumor_from_tips(times_s), tips)
    poses, metal_mm = simulation.tracked(times_s)
    for name, tracked in zip(TRACKED_FRAMES, poses, strict=True):
        assert_same(tracked, [simulation.tracker_from(name, time_s) for time_s in single])
    ends = np.array([[0.0, 0.0, -HANDLE_END_MM]])
    for (start_mm, end_mm), time_s in zip(metal_mm, single, strict=True):
        base = simulation.tracker_from_base
        np.testing.assert_allclose(start_mm, base.translation_mm)
        tracker_from_tip = base @ simulation.base_from_tip(time_s)
        np.testing.assert_allclose(end_mm, tracker_from_tip.apply(ends)[0])
