"""ADF mechanisms with closed loops, compared with plain matrices and closed formulas."""

import math

import numpy as np
import pytest
import yaml

from app.robot import AdfError, IkOptions, JointError, UnreachableError, load_adf
from tests.oracles.ambf_mechanism import link_poses, loop_gaps

pytestmark = pytest.mark.slow

DEPENDENT = {"back-bottom": -1.0, "bottom-end": 1.0, "back-top": -1.0, "yaw-front": 1.0}
"""Joint of the parallelograms -> its position as a multiple of that of ``yaw-back``: opposite sides
stay parallel."""

FREE = ("base-yaw", "end-insertion", "insertion-roll", "roll-wrist", "wrist-jawleft")


@pytest.fixture(scope="module")
def folder(project_root):
    return project_root / "data" / "robots" / "parallelogram"


def read(path):
    """The robot and the values of its text, with the names of joints as the simulator has them."""
    document = yaml.safe_load(path.read_text())
    for key in document["joints"]:
        document[key]["name"] = document[key]["name"].replace(" ", "")
    return load_adf(path), document


def by_body(document, links):
    return {key: links[document[key]["name"].replace(" ", "")].matrix for key in document["bodies"]}


@pytest.fixture(scope="module")
def robots(folder):
    """The shipped robots with closed loops and the values of their texts, by name."""
    return {name: read(folder / f"{name}.yaml") for name in ("parallelogram", "two_arms")}


def written(folder, tmp_path, change, name="parallelogram"):
    """A copy of the file of a shipped robot with changed values."""
    document = yaml.safe_load((folder / f"{name}.yaml").read_text())
    path = tmp_path / "changed.yaml"
    path.write_text(yaml.safe_dump(change(document) or document, sort_keys=False))
    return path


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("name", "arms"), [("parallelogram", [""]), ("two_arms", ["left", "right"])]
)
def test_links_are_where_plain_matrices_put_them_and_loops_are_closed(robots, name, arms, seed):
    robot, document = robots[name]
    rng = np.random.default_rng(seed)
    given, all_positions = {}, {}
    for arm in arms:
        pitch = rng.uniform(-0.9, 0.9)
        given |= {f"{arm}{joint}": rng.uniform(-1.0, 1.0) for joint in FREE}
        given[f"{arm}end-insertion"] = rng.uniform(0.0, 0.24)
        given[f"{arm}yaw-back"] = pitch
        all_positions |= {f"{arm}{joint}": k * pitch for joint, k in DEPENDENT.items()}
    all_positions |= given
    poses = by_body(document, robot.forward_kinematics(given))
    expected = link_poses(document, all_positions)
    for body, pose in poses.items():
        np.testing.assert_allclose(pose, expected[body], rtol=0, atol=1e-9, err_msg=body)
    for joint, gap_mm, gap_rad in loop_gaps(document, poses):
        assert max(gap_mm, gap_rad) < 1e-9, joint


def test_independent_joints_are_those_at_the_root(robots):
    robot, document = robots["two_arms"]
    assert len(document["bodies"]) == 26
    assert len(robot.closures) == 6
    names = {f"{arm}{joint}" for arm in ("left", "right") for joint in DEPENDENT}
    assert set(robot.dependent_joint_names) == names
    assert "leftyaw-back" in robot.actuated_joint_names
    assert robot.joints_that_move("leftend") >= {"leftyaw-back", "leftback-bottom"}
    assert robot.is_determined("leftend", {"leftbase-yaw", "leftyaw-back"})
    assert not robot.is_determined("leftend", {"leftbase-yaw", "leftback-bottom"})
    with pytest.raises(JointError, match="'leftyaw-back', which moves 'leftend', has no position"):
        robot.measured_kinematics("leftend", {"leftbase-yaw": 0.1})


def test_shaft_passes_through_the_remote_centre(robots):
    robot, _ = robots["parallelogram"]
    rng = np.random.default_rng(1)
    for _ in range(20):
        yaw, pitch, depth = rng.uniform((-1.5, -0.9, 0.0), (1.5, 0.9, 0.24))
        given = {"base-yaw": yaw, "yaw-back": pitch, "end-insertion": depth}
        shaft = robot.forward_kinematics(given)["roll"]
        to_centre = np.array([500.0, 0.0, 0.0]) - shaft.translation_mm
        across = np.cross(shaft.rotation[:, 2], to_centre)
        assert np.linalg.norm(across) < 1e-9


def test_inverse_kinematics_keeps_the_loops_closed(robots):
    robot, _ = robots["parallelogram"]
    given = {"base-yaw": -0.3, "yaw-back": 0.5, "end-insertion": 0.05, "roll-wrist": 0.2}
    goal = robot.forward_kinematics(given)["wrist"]
    found = robot.inverse_kinematics("wrist", goal, seed={})
    assert not set(found) & set(DEPENDENT)
    reached = robot.forward_kinematics(found)["wrist"]
    np.testing.assert_allclose(reached.matrix, goal.matrix, atol=1e-6)
    with pytest.raises(JointError, match="'back-top' follows from a closed loop"):
        robot.inverse_kinematics("wrist", goal, seed={"back-top": 0.1})
    far = robot.forward_kinematics({"end-insertion": 3.0})["wrist"]
    with pytest.raises(UnreachableError):
        robot.inverse_kinematics("wrist", far, options=IkOptions(restarts=3))


def test_measured_position_that_contradicts_the_loop_is_an_error(robots):
    robot, _ = robots["parallelogram"]
    measured = {"yaw-back": 0.4, "back-top": -0.41}
    assert robot.forward_kinematics(measured)["top"] is not None
    with pytest.raises(JointError, match=r"'back-top' is 0.4, but its loop closes at -0.4"):
        robot.forward_kinematics({**measured, "back-top": 0.4})
    with pytest.raises(JointError, match="for a closed loop"):
        robot.forward_kinematics({"yaw-back": 1e9})


def rounded(document, digits):
    """``document`` with numbers of so many digits after the point, as the Blender add-on writes."""
    if isinstance(document, dict):
        return {key: rounded(value, digits) for key, value in document.items()}
    if isinstance(document, list):
        return [rounded(value, digits) for value in document]
    return round(document, digits) if isinstance(document, float) else document


def test_rounded_numbers_close_up_to_their_rounding_with_a_warning(folder, robots, tmp_path):
    path = written(folder, tmp_path, lambda document: rounded(document, 3), "two_arms")
    robot, document = read(path)
    assert any("closes its loop up to" in warning for warning in robot.warnings)
    exact, _ = robots["two_arms"]
    given = {"leftyaw-back": 0.6, "leftbase-yaw": 0.3}
    links, peers = robot.forward_kinematics(given), exact.forward_kinematics(given)
    for link in ("leftend", "leftbottom", "lefttop", "leftfront"):
        apart = links[link].translation_mm - peers[link].translation_mm
        assert np.linalg.norm(apart) < 2.0
    gaps = loop_gaps(document, by_body(document, links))
    assert max(gap_mm for name, gap_mm, _ in gaps if name.startswith("left")) < 2.0


def test_rounded_axis_through_a_closed_point_stays_independent(folder, robots, tmp_path):
    """The remote centre is held by the base: the yaw axis misses it by 0.1 mm and moves nothing."""

    def hold(document):
        pivot = {"x": 0.5, "y": 0.0, "z": 0.0001}
        document["JOINT yaw-end"] |= {"parent": "BODY base", "parent pivot": pivot}
        document["JOINT top-end"]["child pivot"]["y"] += 0.0002

    robot, document = read(written(folder, tmp_path, hold))
    assert set(robot.dependent_joint_names) == set(DEPENDENT)
    exact, _ = robots["parallelogram"]
    for given in ({}, {"base-yaw": 0.8, "yaw-back": -0.5, "end-insertion": 0.1}):
        poses = by_body(document, robot.forward_kinematics(given))
        for body, peer in by_body(document, exact.forward_kinematics(given)).items():
            assert np.linalg.norm(poses[body][:3, 3] - peer[:3, 3]) < 1.0, (given, body)


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        # It closes only far from position 0.
        (("JOINT yaw-back", "joint offset"), 0.3, r"is at .* where its loop closes.*most 0\.0524"),
        (("JOINT front-bottom", "parent pivot", "x"), 0.4, "does not close its loop.*at most 2 mm"),
    ],
)
def test_loop_that_does_not_close_is_refused(folder, tmp_path, keys, value, message):
    def change(document):
        *outer, last = keys
        for key in outer:
            document = document[key]
        document[last] = value + (document[last] if last == "joint offset" else 0.0)

    with pytest.raises(AdfError, match=message):
        load_adf(written(folder, tmp_path, change))


def test_loop_that_cannot_follow_its_joints_is_refused(tmp_path):
    path = tmp_path / "crank.yaml"
    path.write_text(CRANK)
    robot = load_adf(path)
    assert robot.dependent_joint_names == ("ab", "gc")
    with pytest.raises(JointError, match="'bc' between 'b' and 'c' does not close its loop"):
        robot.forward_kinematics({"ga": -math.pi / 2})


def hinge(name, parent, child, parent_pivot, child_pivot="x: 0.0, y: 0.0, z: 0.0"):
    return f"""
JOINT {name}: {{name: {name}, type: revolute, parent: BODY {parent}, child: BODY {child},
  parent axis: {{x: 0.0, y: 0.0, z: 1.0}}, child axis: {{x: 0.0, y: 0.0, z: 1.0}},
  parent pivot: {{{parent_pivot}}}, child pivot: {{{child_pivot}}}}}"""


CRANK = (
    "bodies: [BODY g, BODY a, BODY b, BODY c]\njoints: [JOINT ga, JOINT ab, JOINT gc, JOINT bc]\n"
    + "".join(
        f"BODY {name}: {{name: {name}, location: {{position: {{x: {x}, y: {y}, z: 0.0}}}}}}\n"
        for name, x, y in (("g", 0, 0), ("a", 0, 0), ("b", 0, 0.05), ("c", 0.03, 0))
    )
    + hinge("ga", "g", "a", "x: 0.0, y: 0.0, z: 0.0")
    + hinge("ab", "a", "b", "x: 0.0, y: 0.05, z: 0.0")
    + hinge("gc", "g", "c", "x: 0.03, y: 0.0, z: 0.0")
    + hinge("bc", "b", "c", "x: 0.03, y: 0.02, z: 0.0", "x: 0.0, y: 0.07, z: 0.0")
)
"""Four bars of 30 (ground), 50, 36 and 70 mm: with ``ga`` at -90 degrees they do not meet."""
