"""A robot without joints follows its tool; compared with recorded joints."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import yaml

from app.case import open_case
from app.geometry import Transform
from app.registration import DriftBound, given_registration
from app.robot import UnreachableError
from app.session import RobotSetup, Session, setup_from_case
from app.session.link_poses import OUT_OF_REACH, IkFollower

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def recorded(case):
    return setup_from_case(case)


def robot_setup(touch, **more):
    registration = given_registration(
        Transform("reference", "robot_base", np.eye(3), [100.0, 0.0, 50.0])
    )
    bound = DriftBound(5.0, 0.1)
    return RobotSetup(touch, "robot_base", "stylus", registration, bound, follows_tool=True, **more)


def test_inverse_kinematics_reproduces_recorded_links(case, recorded):
    following = replace(recorded, robot=replace(recorded.robot, follows_tool=True))
    by_joints, by_tool = Session(recorded), Session(following)
    compared = 0
    for frame in islice(case.frames(), 0, 600, 5):
        measured, followed = by_joints.step(frame), by_tool.step(frame)
        assert followed.drift is None
        assert followed.decision.state == measured.decision.state
        if not (measured.links and followed.links):
            continue
        compared += 1
        there, here = measured.links["stylus"], followed.links["stylus"]
        # The tracker's noise and the registration's error are about a millimetre.
        assert here.distance_mm_to(there) < 4.0
        assert here.angle_to(there) < np.radians(3.0)
    assert compared > 90


def test_tool_link_reaches_the_tool_with_and_without_a_mount(touch):
    rng = np.random.default_rng(5)
    mount = Transform.from_rotation_vector(
        [0.2, -0.5, 0.1], [0.0, 0.0, 0.0], target="stylus", source="cautery_tip"
    )
    for link_from_tip in (None, mount):
        follower = IkFollower(robot_setup(touch, link_from_tip=link_from_tip))
        reference_from_base = robot_setup(touch).registration.transform
        positions = np.array([0.1, 0.4, 0.3, 0.2, -0.3, 0.1])
        for _ in range(20):
            positions = positions + rng.uniform(-0.03, 0.03, 6)
            given = dict(zip(touch.actuated_joint_names, positions, strict=True))
            link = touch.forward_kinematics(given)["stylus"].renamed(target="robot_base")
            tip = link.renamed(source="cautery_tip") if link_from_tip is None else link @ mount
            links = follower.links(reference_from_base @ tip)
            assert links["stylus"].distance_mm_to(link.renamed(target="touch_base")) < 1e-3


def test_robot_follows_again_after_poses_out_of_reach(touch):
    follower = IkFollower(robot_setup(touch))
    reference_from_base = robot_setup(touch).registration.transform
    near = touch.forward_kinematics(dict.fromkeys(touch.actuated_joint_names, 0.2))["stylus"]
    reachable = reference_from_base @ near.renamed(target="robot_base", source="cautery_tip")
    assert follower.links(reachable)
    far = Transform("reference", "cautery_tip", np.eye(3), [5000.0, 0.0, 0.0])
    for _ in range(3):
        with pytest.raises(UnreachableError, match=r"'stylus' cannot be moved to .* mm"):
            follower.links(far)
    assert follower.links(reachable)["stylus"].distance_mm_to(near) < 1e-3


def test_session_reports_a_tool_out_of_reach(case, recorded):
    away = given_registration(Transform("reference", "robot_base", np.eye(3), [3000.0, 0.0, 0.0]))
    robot = replace(recorded.robot, follows_tool=True, registration=away)
    session = Session(replace(recorded, robot=robot))
    steps = [session.step(frame) for frame in islice(case.frames(), 10)]
    assert [dict(step.links) for step in steps] == [{}] * 10
    problems = [step.robot_problem for step in steps]
    assert any(problem.startswith(f"{OUT_OF_REACH}: link 'stylus'") for problem in problems)


def test_robot_of_a_case_without_joint_states_follows_the_tool(recorded, tmp_path, project_root):
    """The manifest has no joint states; the registration is given, because dwells need joints."""
    source = project_root / "data" / "recorded_case"
    found = recorded.robot.registration.transform
    manifest = yaml.safe_load((source / "case.yaml").read_text())
    del manifest["robot"]["joint_states"]
    manifest["clock"] = {"offset_robot_to_tracker_ms": 0.0}
    manifest["registration"] = {"method": "given", "matrix": found.matrix.ravel().tolist()}
    for path in source.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(manifest))
    without = open_case(tmp_path)
    setup = setup_from_case(without)
    assert setup.robot.follows_tool
    session = Session(setup)
    steps = [session.step(frame) for frame in islice(without.frames(), 100)]
    assert sum(bool(step.links) for step in steps) > 50
    assert all(step.links or step.robot_problem for step in steps)
    assert {step.joints for step in steps} == {None}


def test_pose_on_another_branch_is_found_within_a_few_frames(touch):
    """The seed's own branch ends at a joint limit; another start finds the solution."""
    rng = np.random.default_rng(11)
    low = np.array([joint.lower for joint in touch.joints if joint.moves])
    high = np.array([joint.upper for joint in touch.joints if joint.moves])
    reference_from_base = robot_setup(touch).registration.transform
    waits = []
    for _ in range(8):
        follower = IkFollower(robot_setup(touch))
        positions = dict(zip(touch.actuated_joint_names, rng.uniform(low, high), strict=True))
        link = touch.forward_kinematics(positions)["stylus"]
        tip = reference_from_base @ link.renamed(target="robot_base", source="cautery_tip")
        for wait in range(300):
            try:
                links = follower.links(tip)
            except UnreachableError:
                continue
            assert links["stylus"].distance_mm_to(link) < 1e-3
            waits.append(wait)
            break
    assert len(waits) == 8
    assert max(waits) > 0, "none of them needed another start: the test shows nothing"
