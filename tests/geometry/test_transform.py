"""Rigid transforms against matrices, scipy and their frame rules."""

import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from app.geometry import FrameError, Transform, TransformError, mean_transform, rotation_angle
from tests.geometry.few_examples import given

finite = st.floats(-1e4, 1e4, allow_nan=False)
vectors = hnp.arrays(np.float64, 3, elements=finite)
rotation_vectors = hnp.arrays(np.float64, 3, elements=st.floats(-3.0, 3.0))


def transforms(target: str, source: str) -> st.SearchStrategy[Transform]:
    return st.builds(
        lambda turn, move: Transform.from_rotation_vector(turn, move, target=target, source=source),
        rotation_vectors,
        vectors,
    )


@given(transforms("a", "b"), transforms("b", "c"), transforms("c", "d"))
def test_composition_is_associative_and_equals_the_matrix_product(ab, bc, cd):
    left, right = (ab @ bc) @ cd, ab @ (bc @ cd)
    assert (left.target, left.source) == ("a", "d")
    np.testing.assert_allclose(left.matrix, right.matrix, atol=1e-9)
    np.testing.assert_allclose(left.matrix, ab.matrix @ bc.matrix @ cd.matrix, atol=1e-9)


@given(transforms("a", "b"))
def test_inverse_and_identity_compose_as_matrices(ab):
    round_trip = ab @ ab.inverse()
    assert (round_trip.target, round_trip.source) == ("a", "a")
    np.testing.assert_allclose(round_trip.matrix, np.eye(4), atol=1e-9)
    np.testing.assert_array_equal((ab @ Transform.identity("b", "b")).matrix, ab.matrix)


@given(transforms("a", "b"), hnp.arrays(np.float64, (5, 3), elements=finite))
def test_apply_maps_points_and_rotate_maps_directions(ab, points):
    homogeneous = np.c_[points, np.ones(5)] @ ab.matrix.T
    np.testing.assert_allclose(ab.apply(points), homogeneous[:, :3], atol=1e-8)
    np.testing.assert_allclose(ab.rotate(points), ab.apply(points) - ab.apply([0, 0, 0]), atol=1e-8)
    np.testing.assert_allclose(ab.apply(points[0]), homogeneous[0, :3], atol=1e-8)


@given(rotation_vectors)
def test_rotation_vector_equals_the_matrix_exponential(vector):
    x, y, z = vector
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    built = Transform.from_rotation_vector(vector, [0, 0, 0], target="a", source="b")
    np.testing.assert_allclose(built.rotation, expm(skew), atol=1e-9)


@given(transforms("a", "b"))
def test_quaternion_round_trip_has_w_not_negative(ab):
    quaternion = ab.quaternion_xyzw
    assert quaternion[3] >= 0.0
    again = Transform.from_quaternion(quaternion, ab.translation_mm, target="a", source="b")
    np.testing.assert_allclose(again.matrix, ab.matrix, atol=1e-12)


@given(hnp.arrays(np.float64, 4, elements=st.floats(-1.0, 1.0)))
def test_quaternion_rotation_agrees_with_scipy(numbers):
    assume(np.linalg.norm(numbers) > 1e-3)
    unit = numbers / np.linalg.norm(numbers) * 1.0005
    built = Transform.from_quaternion(unit, [1.0, 2.0, 3.0], target="a", source="b")
    np.testing.assert_allclose(built.rotation, Rotation.from_quat(unit).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(built.rotation.T @ built.rotation, np.eye(3), atol=1e-14)


AXES = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 2), (0, 0, -1), (3, -4, 12)]


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, 2.5, np.pi - 1e-7, np.pi])
@pytest.mark.parametrize("axis", AXES)
def test_quaternion_and_interpolation_agree_with_scipy(axis, angle):
    vector = angle * np.array(axis) / np.linalg.norm(axis)
    turn = Transform("a", "b", Rotation.from_rotvec(vector).as_matrix(), np.zeros(3))
    expected = Rotation.from_matrix(turn.rotation)
    quaternion = expected.as_quat(canonical=True)
    if quaternion[3] < 1e-12:  # half a turn: rounding decides the sign
        quaternion *= np.sign(quaternion @ turn.quaternion_xyzw)
    np.testing.assert_allclose(turn.quaternion_xyzw, quaternion, atol=1e-14)
    start = Transform.from_rotation_vector([0.3, -0.2, 0.5], [0, 0, 0], target="c", source="a")
    found = (start @ Transform.identity("a", "b")).interpolate(start @ turn, 0.25).rotation
    part = Rotation.from_rotvec(0.25 * expected.as_rotvec()).as_matrix()
    back = Rotation.from_rotvec(-0.25 * expected.as_rotvec()).as_matrix()
    nearest = part if np.abs(start.rotation @ part - found).max() < 1e-7 else back
    assert nearest is part or angle == np.pi  # of half a turn both ways are shortest
    np.testing.assert_allclose(found, start.rotation @ nearest, atol=1e-13)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, np.pi - 1e-7, np.pi])
def test_rotation_angle_is_accurate_near_zero_and_near_pi(angle):
    rotation = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
    assert rotation_angle(rotation) == pytest.approx(angle, abs=1e-12)


@given(transforms("a", "b"), transforms("a", "b"), st.floats(0.0, 1.0))
def test_interpolation_has_constant_speed_between_its_ends(first, last, fraction):
    between = first.interpolate(last, fraction)
    np.testing.assert_allclose(first.interpolate(last, 0.0).matrix, first.matrix, atol=1e-9)
    assert first.interpolate(last, 1.0).angle_to(last) < 1e-6
    assert between.angle_to(first) == pytest.approx(fraction * first.angle_to(last), abs=1e-6)
    way_mm = fraction * first.distance_mm_to(last)
    assert between.distance_mm_to(first) == pytest.approx(way_mm, abs=1e-8)


def test_mismatched_frames_are_rejected():
    ab = Transform.identity("a", "b")
    with pytest.raises(FrameError, match="a_from_b cannot be multiplied by c_from_d: 'b' is not"):
        ab @ Transform.identity("c", "d")
    with pytest.raises(FrameError, match="different frames"):
        ab.angle_to(Transform.identity("a", "c"))
    with pytest.raises(FrameError, match="different frames"):
        ab.interpolate(ab.inverse(), 0.5)
    with pytest.raises(FrameError, match="'two words'"):
        Transform.identity("two words", "b")


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        (np.diag([1.0, 1.0, -1.0]), r"is a reflection; expected determinant \+1"),
        (-np.eye(3), "is a reflection"),
        (
            np.diag([1.01, 1.01, 1.01]),
            r"rotation of a_from_b is not orthonormal: R\^T R differs from 1 by 0\.02\d*; exp",
        ),
        (np.diag([1.001, 1.001, 1.001]), "not orthonormal"),
        (np.array([[1, 0.1, 0], [0, 1, 0], [0, 0, 1.0]]), "not orthonormal"),
        (np.zeros((3, 3)), "not orthonormal"),
        (np.full((3, 3), np.nan), "not finite: .*; expected finite numbers"),
        (np.eye(4), r"shape \(4, 4\)"),
        ("spin", "'spin'; expected an array of numbers"),
    ],
)
def test_matrix_that_is_not_a_rotation_is_rejected(rotation, message):
    with pytest.raises(TransformError, match=message) as caught:
        Transform("a", "b", rotation, np.zeros(3))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_non_finite_translation_is_rejected(bad):
    with pytest.raises(TransformError, match=rf"_mm of a_from_b is not finite: \[0\.0, {bad}, 0"):
        Transform("a", "b", np.eye(3), [0.0, bad, 0.0])


@given(rotation_vectors, hnp.arrays(np.float64, (3, 3), elements=st.floats(-1e-5, 1e-5)))
def test_rounded_matrix_is_replaced_by_the_nearest_rotation(vector, noise):
    exact = Rotation.from_rotvec(vector).as_matrix()
    built = Transform("a", "b", exact + noise, np.zeros(3))
    np.testing.assert_allclose(built.rotation.T @ built.rotation, np.eye(3), atol=1e-14)
    # The determinant sums three of the six entries that are each exact to 1e-14.
    assert np.linalg.det(built.rotation) == pytest.approx(1.0, abs=3e-14)
    np.testing.assert_allclose(built.rotation, exact, atol=1e-4)


def test_matrix_numbers_are_in_row_order_and_the_last_row_is_checked():
    numbers = [0, -1, 0, 10, 1, 0, 0, 20, 0, 0, 1, 30, 0, 0, 0, 1]
    built = Transform.from_matrix(numbers, target="a", source="b")
    np.testing.assert_array_equal(built.apply([1.0, 0.0, 0.0]), [10.0, 21.0, 30.0])
    for message, wrong in (
        ("last row", [*numbers[:12], 10, 20, 30, 1]),
        (r"shape \(15,\)", numbers[:15]),
        ("expected an array of numbers", ["x"] * 16),
    ):
        with pytest.raises(TransformError, match=message):
            Transform.from_matrix(wrong, target="a", source="b")


def test_quaternion_with_wrong_norm_is_rejected():
    with pytest.raises(TransformError, match=r"norm 0;"):
        Transform.from_quaternion([0, 0, 0, 0], [0, 0, 0], target="a", source="b")
    with pytest.raises(TransformError, match=r"norm 1\.1"):
        Transform.from_quaternion([0, 0, 0, 1.1], [0, 0, 0], target="a", source="b")


def test_arrays_are_read_only_copies():
    rotation, translation = np.eye(3), np.zeros(3)
    built = Transform("a", "b", rotation, translation)
    rotation[0, 0] = translation[0] = 5.0
    np.testing.assert_array_equal(built.matrix, np.eye(4))
    for value in (built, built.inverse(), built @ Transform.identity("b", "c")):
        with pytest.raises(ValueError, match="read-only"):
            value.rotation[0, 0] = 2.0
        with pytest.raises(ValueError, match="read-only"):
            value.translation_mm[0] = 2.0


@given(transforms("a", "b"), rotation_vectors, vectors)
def test_mean_of_opposite_motions_of_a_pose_is_the_pose(pose, turn, move):
    turn = 0.3 * turn  # far from half a turn, where the mean rotation is not unique
    forward = Transform.from_rotation_vector(turn, move, target="b", source="b")
    backward = Transform.from_rotation_vector(-turn, -move, target="b", source="b")
    found = mean_transform([pose @ forward, pose @ backward])
    np.testing.assert_allclose(found.matrix, pose.matrix, atol=1e-7)


@given(st.lists(transforms("a", "b"), min_size=2, max_size=6))
def test_mean_rotation_is_that_of_scipy(poses):
    rotations = np.stack([pose.rotation for pose in poses])
    _, second, third = np.linalg.svd(rotations.mean(axis=0), compute_uv=False)
    assume(second - third > 1e-3)  # otherwise the mean may not be unique
    expected = Rotation.from_matrix(rotations).mean().as_matrix()
    np.testing.assert_allclose(mean_transform(poses).rotation, expected, atol=1e-9)


def test_mean_of_no_transforms_or_of_different_frames_is_rejected():
    with pytest.raises(TransformError, match="0 transforms"):
        mean_transform([])
    with pytest.raises(FrameError, match="different frames"):
        mean_transform([Transform.identity("a", "b"), Transform.identity("a", "c")])


def test_product_of_ten_thousand_rotations_is_a_rotation():
    """Products are not projected to the nearest rotation: their error stays far below tolerance."""
    rng = np.random.default_rng(3)
    turns = Rotation.random(10_000, random_state=rng)
    product = Transform.identity("a", "a")
    for turn in turns.as_matrix():
        product = product @ Transform("a", "a", turn, rng.normal(size=3))
    assert np.abs(product.rotation.T @ product.rotation - np.eye(3)).max() < 1e-11
    assert np.linalg.det(product.rotation) == pytest.approx(1.0, abs=1e-11)


def test_unchecked_takes_arrays_without_copy_and_checks_names():
    rotation, translation = np.eye(3), np.array([1.0, 2.0, 3.0])
    built = Transform.unchecked("a", "b", rotation, translation)
    assert built.rotation is rotation
    np.testing.assert_array_equal(built.matrix, Transform("a", "b", rotation, translation).matrix)
    with pytest.raises(ValueError, match="read-only"):
        translation[0] = 2.0
    with pytest.raises(FrameError, match="' b'"):
        Transform.unchecked("a", " b", np.eye(3), np.zeros(3))


def test_renamed_keeps_frames_that_are_not_given():
    pose = Transform.identity("a", "b")
    assert (pose.renamed(source="c").target, pose.renamed(source="c").source) == ("a", "c")
    with pytest.raises(FrameError, match="''"):
        pose.renamed(target="")
