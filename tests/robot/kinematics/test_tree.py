"""The tree of links: mimic chains, the Jacobian, link poses, and refusal of other graphs."""

import numpy as np
import pytest

from app.geometry import Transform
from app.robot import Joint, JointError, JointType, Link, Mimic, Robot, UrdfError
from app.robot.kinematic_tree import LinkPoses


def joint(name, parent, child, kind="revolute", *, axis=(0, 0, 1), at=(0, 0, 0), mimic=None):
    origin = Transform(parent, child, np.eye(3), np.array(at, dtype=float))
    return Joint(name, JointType(kind), origin, np.array(axis, dtype=float), -9.0, 9.0, mimic)


def robot(*joints, links="abcde"):
    return Robot("test", tuple(Link(name) for name in links), joints)


def angle(transform):
    return transform.rotation_vector[2]


def test_chain_of_mimic_joints_applies_multipliers_and_offsets():
    arm = robot(
        # before its leader in the list
        joint("third", "c", "d", mimic=Mimic("second", -1.0, 0.25)),
        joint("second", "b", "c", mimic=Mimic("first", 2.0, 0.1)),
        joint("first", "a", "b"),
        links="abcd",
    )
    links = arm.forward_kinematics({"first": 0.2})
    assert arm.actuated_joint_names == ("first",)
    # 0.2, then 0.1 + 2 * 0.2 = 0.5, then 0.25 - 0.5
    assert angle(links["b"]) == pytest.approx(0.2)
    assert angle(links["c"]) == pytest.approx(0.2 + 0.5)
    assert angle(links["d"]) == pytest.approx(0.2 + 0.5 - 0.25)


def test_mimic_joint_is_at_its_offset_by_default_and_a_given_position_takes_precedence():
    arm = robot(
        joint("first", "a", "b"),
        joint("second", "b", "c", mimic=Mimic("first", 2.0, 0.1)),
        joint("third", "c", "d", mimic=Mimic("second")),
        links="abcd",
    )
    assert angle(arm.forward_kinematics({})["c"]) == pytest.approx(0.1)
    links = arm.forward_kinematics({"first": 0.2, "second": 0.3})
    assert angle(links["c"]) == pytest.approx(0.5)
    assert angle(links["d"]) == pytest.approx(0.8)


def test_measured_kinematics_requires_every_joint_that_moves_the_link():
    """A joint without measurement would be at 0 and the link at a wrong pose."""
    arm = robot(
        joint("shoulder", "a", "b"),
        joint("elbow", "b", "c", at=(100, 0, 0), mimic=Mimic("shoulder", -2.0)),
        joint("wrist", "c", "d", at=(100, 0, 0)),
        joint("finger", "d", "e", kind="prismatic"),
    )
    measured = {"shoulder": 0.2, "wrist": 0.3}
    found, expected = arm.measured_kinematics("d", measured), arm.forward_kinematics(measured)
    np.testing.assert_array_equal(found["d"].matrix, expected["d"].matrix)
    arm.measured_kinematics("a", {})  # nothing moves the root
    arm.measured_kinematics("c", {"shoulder": 0.2, "elbow": -0.5})
    for link, positions, message in (
        ("d", {"shoulder": 0.2}, "'wrist', which moves 'd', has no position; expected shoulder, "),
        # The shoulder moves b, the parent of c.
        ("c", {"elbow": -0.5}, "'shoulder', which moves 'c', has no position"),
        ("e", measured, "'finger'"),
        ("hand", measured, "'hand' is unknown"),
    ):
        with pytest.raises(JointError, match=message):
            arm.measured_kinematics(link, positions)
    assert arm.is_determined("d", {"shoulder", "wrist"})
    assert not arm.is_determined("e", {"shoulder", "wrist"})
    assert not arm.is_determined("d", {"finger"})
    assert arm.joints_that_move("d") == {"shoulder", "elbow", "wrist"}
    assert arm.joints_that_move("b") == {"shoulder"}


def test_prismatic_positions_are_metres_along_a_unit_axis():
    arm = robot(joint("slide", "a", "b", "prismatic", axis=(0, 3, 4)), links="ab")
    shift = arm.forward_kinematics({"slide": 0.01})["b"].translation_mm
    np.testing.assert_allclose(shift, [0, 6, 8])


def test_jacobian_is_the_derivative_of_the_pose(rng):
    arm = robot(
        joint("first", "a", "b", axis=(1, 2, 2), at=(10, 0, 5)),
        joint("slide", "b", "c", "prismatic", axis=(0, 1, 1), at=(0, 20, 0)),
        joint("follow", "c", "d", axis=(0, 1, 0), at=(30, 0, 0), mimic=Mimic("first", -1.5, 0.2)),
        joint("last", "d", "e", axis=(1, 0, 0), at=(0, 0, 40)),
    )
    tree = arm._tree
    names = list(arm.actuated_joint_names)
    for _ in range(10):
        at = dict(zip(names, rng.uniform(-1, 1, 3), strict=True))
        matrices = tree.link_matrices(tree.complete_positions(at))
        jacobian = tree.jacobian("e", names, matrices)
        for column, name in enumerate(names):
            step = 1e-6
            low = arm.forward_kinematics({**at, name: at[name] - step})["e"]
            high = arm.forward_kinematics({**at, name: at[name] + step})["e"]
            velocity = (high.translation_mm - low.translation_mm) / (2 * step)
            turn = Transform("a", "a", high.rotation @ low.rotation.T, np.zeros(3))
            np.testing.assert_allclose(jacobian[:3, column], velocity, rtol=1e-6, atol=1e-5)
            spin = turn.rotation_vector / (2 * step)
            np.testing.assert_allclose(jacobian[3:, column], spin, rtol=1e-6, atol=1e-6)


K = joint("k", "b", "c", mimic=Mimic("j"))
J = joint("j", "a", "b", mimic=Mimic("k"))


@pytest.mark.parametrize(
    ("joints", "links", "message"),
    [
        ([], "ab", "a, b have no parent joint; expected one root"),
        ([joint("j", "a", "b"), joint("k", "b", "a")], "ab", "loop"),
        ([joint("j", "b", "c"), joint("k", "c", "b")], "abc", "b, c form a loop"),
        ([joint("j", "a", "c"), joint("k", "b", "c")], "abc", "'c' is the child of.*'j' and 'k'"),
        ([joint("j", "a", "x")], "ab", "child 'x' of joint 'j' is not a link; expected one"),
        ([joint("j", "x", "b")], "ab", "parent 'x' of joint 'j' is not a link"),
        ([J], "ab", "'j' mimics 'k'; expected a moving joint"),
        (
            [joint("j", "a", "b", mimic=Mimic("j"))],
            "ab",
            "'j' mimics itself, .*; expected another joint",
        ),
        ([J, K], "abc", "mimics itself"),
        ([J, joint("k", "b", "c", "fixed")], "abc", "'j' mimics 'k'; expected a moving joint"),
    ],
)
def test_graph_that_is_not_one_tree_is_refused(joints, links, message):
    with pytest.raises(UrdfError, match=message):
        robot(*joints, links=links)


def test_position_of_a_fixed_joint_is_refused():
    arm = robot(joint("bolt", "a", "b", "fixed"), links="ab")
    assert arm.actuated_joint_names == ()
    with pytest.raises(JointError, match=r"'bolt' is fixed"):
        arm.forward_kinematics({"bolt": 0.0})


def test_joints_without_direction_or_with_crossed_limits_are_refused():
    with pytest.raises(UrdfError, match="axis of joint 'j'"):
        joint("j", "a", "b", axis=(0, 0, 0))
    with pytest.raises(UrdfError, match=r"limits of joint 'j' are 1.0 to 0.0"):
        Joint("j", JointType.REVOLUTE, Transform.identity("a", "b"), np.eye(3)[2], 1.0, 0.0)
    with pytest.raises(UrdfError, match="nan"):
        Mimic("j", float("nan"))


def test_mapping_returns_the_pose_of_each_link():
    quarter = [[0.0, -1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0], [0.0] * 3 + [1.0]]
    poses = LinkPoses("base", {"base": 0, "arm": 1}, np.array([np.eye(4), quarter]))
    assert (list(poses), len(poses), "leg" in poses) == (["base", "arm"], 2, False)
    assert (poses["arm"].target, poses["arm"].source) == ("base", "arm")
    assert poses["arm"].apply([1.0, 0.0, 0.0]).tolist() == [1.0, 3.0, 3.0]
    assert {link: pose.translation_mm.tolist() for link, pose in poses.items()} == {
        "base": [0.0, 0.0, 0.0],
        "arm": [1.0, 2.0, 3.0],
    }
    with pytest.raises(ValueError, match="read-only"):
        poses["arm"].rotation[0, 0] = 1.0
    with pytest.raises(KeyError, match="leg"):
        poses["leg"]
