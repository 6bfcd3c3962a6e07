from dataclasses import replace

import numpy as np
import pytest

from app.fixture import LimiterParameters, MarginState, Proximity, Reason, Witnesses, limit_twist
from app.geometry import (
    FrameError,
    Stamp,
    StampError,
    TrackedTransform,
    TrackingStatus,
    Transform,
)
from app.hold import NotRearmableError
from app.registration import DriftBound, given_registration, predict_tre, register_points
from app.robot import Robot
from app.session import RobotSetup, Session, SessionSetup
from tests.doubles import PARAMETERS, AnalyticSphere, frame, joint_sample, lost, sample
from tests.python_process import run_python

TOOL_FROM_TIP = Transform("cautery", "cautery_tip", np.eye(3), [0.0, 0.0, 70.0])
SENSOR_FROM_TUMOR = Transform.from_rotation_vector(
    [0.3, -0.2, 0.5], [5.0, -4.0, 30.0], target="needle", source="tumor"
)
TRACKER_FROM_NEEDLE = Transform.from_rotation_vector(
    [0.1, 0.2, 0.3], [10.0, 20.0, 30.0], target="tracker", source="needle"
)


def make_setup(robot: RobotSetup | None = None) -> SessionSetup:
    return SessionSetup(TOOL_FROM_TIP, SENSOR_FROM_TUMOR, AnalyticSphere(10.0), PARAMETERS, robot)


def valid(pose: Transform, at_ms: float) -> TrackedTransform:
    return TrackedTransform.valid(pose, Stamp(int(at_ms * 1e6)))


def cautery_at(distance_mm: float, at_ms: float) -> TrackedTransform:
    """The cautery with its tip this far from the sphere's centre, along the tumour's x."""
    return valid(tracker_from_cautery([distance_mm, 0.0, 0.0]), at_ms)


def tracker_from_cautery(tip_mm):
    tumor_from_tip = Transform("tumor", "cautery_tip", np.eye(3), tip_mm)
    tracker_from_tumor = TRACKER_FROM_NEEDLE @ SENSOR_FROM_TUMOR
    return tracker_from_tumor @ tumor_from_tip @ TOOL_FROM_TIP.inverse()


def needle(at_ms: float) -> TrackedTransform:
    return valid(TRACKER_FROM_NEEDLE, at_ms)


def frame_at(at_ms: float, distance_mm: float = 40.0, *more, joints=()):
    """A frame with needle and cautery."""
    return frame(at_ms, *more, needle(at_ms), cautery_at(distance_mm, at_ms), joints=joints)


def steps(session: Session, distances, *, start_ms=0.0):
    times = np.arange(len(distances)) * 20.0 + start_ms
    pairs = zip(times, distances, strict=True)
    return [session.step(frame_at(at, distance)) for at, distance in pairs]


def distance_mm(step) -> float:
    return step.decision.proximity.signed_distance_mm


@pytest.fixture
def session() -> Session:
    return Session(make_setup())


def test_distance_is_measured_in_the_tumours_frame():
    (step,) = steps(Session(make_setup()), [17.0])
    assert step.decision.state is MarginState.NEGATIVE
    assert distance_mm(step) == pytest.approx(7.0, abs=1e-9)
    np.testing.assert_allclose(step.tumor_from_tip.translation_mm, [17.0, 0, 0], atol=1e-9)
    assert step.decision.stamp == Stamp(0)


def test_fixture_plane_is_at_the_stop_margin_facing_the_tool():
    (step,) = steps(Session(make_setup()), [17.0])
    fixture = step.virtual_fixture
    assert (fixture.target, fixture.source) == ("tumor", "virtual_fixture")
    np.testing.assert_allclose(fixture.translation_mm, [11.0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(fixture.rotation[:, 2], [1.0, 0, 0], atol=1e-9)


def test_constraint_keeps_recently_governing_planes(session):
    (first,) = steps(session, [12.0])
    aside, offset_mm = cautery_at(12.0, 20).transform, np.array([0.0, 1.5, 0.0])
    aside = Transform("tracker", "cautery", aside.rotation, aside.translation_mm + offset_mm)
    second = session.step(frame(20, needle(20), valid(aside, 20)))
    tip_mm = second.tumor_from_tip.translation_mm
    apart_mm = tip_mm - first.decision.proximity.on_tumor_mm
    planes = second.decision.constraint
    assert len(planes) == 2
    np.testing.assert_allclose(planes.normals[1], apart_mm / np.linalg.norm(apart_mm))
    stop_mm = second.decision.margin.total_mm
    assert planes.clearances_mm[1] == pytest.approx(np.linalg.norm(apart_mm) - stop_mm)


def test_states_follow_the_distance(session):
    found = [step.decision.state.name for step in steps(session, [30.0, 14.0, 9.0, 14.0, 30.0])]
    assert found == ["NEGATIVE", "WARNING", "POSITIVE", "POSITIVE", "POSITIVE"]


@pytest.mark.parametrize("edge", ["cautery", "needle"])
def test_lost_tool_or_tumour_is_unknown_and_holds(session, edge):
    steps(session, [30.0, 30.1])
    poses = {"cautery": cautery_at(30.2, 40), "needle": needle(40)}
    poses[edge] = lost("tracker", edge, 40, TrackingStatus.INVALID)
    step = session.step(frame(40, *poses.values()))
    assert step.decision.state is MarginState.UNKNOWN
    assert step.decision.reasons[0] is Reason.INVALID
    assert step.decision.hold
    assert step.decision.proximity is None
    assert step.tumor_from_tip is None
    assert step.virtual_fixture is not None, "stale never means unconstrained"


@pytest.mark.parametrize("sign", [1, -1])
def test_times_as_far_apart_as_stamps_can_be_are_unknown(session, sign):
    """Compiled code computes ages in 64 bits."""
    edge_ms = sign * 4.6e12
    assert session.step(frame_at(-edge_ms)).decision.state is MarginState.NEGATIVE
    step = session.step(frame(edge_ms, needle(edge_ms), cautery_at(40.0, -edge_ms)))
    assert step.decision.state is MarginState.UNKNOWN
    assert not step.decision.constraint_is_current
    with pytest.raises(StampError, match="out of range"):
        Stamp(2**63)


def test_silent_tracker_is_unknown_from_its_watchdog_frame_on(session):
    steps(session, [30.0, 30.1])
    assert session.step(frame(221)).decision.reasons[0] is Reason.STALE


def test_crossing_between_two_frames_is_a_breach(session):
    before, after, later = steps(session, [30.0, -30.0, -60.0])
    assert before.decision.state is MarginState.NEGATIVE
    assert after.decision.state is MarginState.POSITIVE
    assert distance_mm(after) == pytest.approx(-10.0, abs=0.5)
    assert distance_mm(later) == pytest.approx(50.0)


def test_planes_face_the_tool_after_a_crossing(session):
    _, after = steps(session, [30.0, -14.0])
    planes = after.decision.constraint
    np.testing.assert_allclose(planes.normals[0], [-1.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(planes.points_on_tool_mm[0], [-14.0, 0.0, 0.0], atol=1e-9)
    tip_mm, still = after.tumor_from_tip.translation_mm, np.zeros(6)
    assert limit_twist(still, planes, tip_mm, LimiterParameters()).tolist() == [0.0] * 6
    inward = np.array([50.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    _, inside = steps(Session(make_setup()), [30.0, -10.5])
    planes, tip_mm = inside.decision.constraint, inside.tumor_from_tip.translation_mm
    assert limit_twist(inward, planes, tip_mm, LimiterParameters())[0] < 0.0, "driven out, not in"


def test_two_crossings_in_a_row_are_two_breaches(session):
    found = steps(session, [30.0, -30.0, 30.0])
    distances = [step.decision.proximity.signed_distance_mm for step in found]
    assert [distance < 0.0 for distance in distances] == [False, True, True]


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (frame_at(0, 80.0), frame_at(20, -80.0)),
        (frame_at(0, 30.0), frame(0, cautery_at(-30.0, 0))),
        # Poses are 150 ms old: the limit applies to the time between the frames.
        (
            frame(150, needle(0), cautery_at(30.0, 0)),
            frame(250, needle(100), cautery_at(-30.0, 100)),
        ),
    ],
    ids=["from 70 mm away", "equal stamps", "late samples"],
)
def test_crossing_is_a_breach(session, before, after):
    session.step(before)
    assert session.step(after).decision.state is MarginState.POSITIVE


def test_crossing_while_the_tool_is_lost_is_a_breach(session):
    steps(session, [30.0])
    session.step(frame(20, needle(20), lost("tracker", "cautery", 20, TrackingStatus.MISSING)))
    (after,) = steps(session, [-30.0], start_ms=40.0)
    assert after.decision.state is MarginState.UNKNOWN
    assert distance_mm(after) == pytest.approx(-10.0, abs=0.5)


def test_no_sweep_across_a_clock_jump(session):
    steps(session, [30.0], start_ms=100.0)
    session.step(frame(0))
    (after,) = steps(session, [-30.0], start_ms=150.0)
    assert distance_mm(after) == pytest.approx(20.0)


def test_no_sweep_across_a_change_of_tumor(session):
    steps(session, [30.0])
    session.use(replace(make_setup(), proximity=AnalyticSphere(9.0)))
    (after,) = steps(session, [-30.0], start_ms=20.0)
    assert distance_mm(after) == pytest.approx(21.0)


def test_no_sweep_across_a_gap_longer_than_the_stale_limit(session):
    session.step(frame_at(0, 30.0))
    step = session.step(frame_at(250, -30.0))
    assert distance_mm(step) == pytest.approx(20.0)
    assert step.decision.state is MarginState.UNKNOWN
    assert step.decision.reasons == (Reason.STALE, Reason.LATCHED)


class Vague(AnalyticSphere):
    """Test double: a sphere whose distances are 5 mm too large, with correct lower bounds."""

    def evaluate(self, tumor_from_tool, stamp=None):
        exact = super().evaluate(tumor_from_tool, stamp)
        distance_mm = round(exact.signed_distance_mm, 9)
        distance_mm += 5.0 if distance_mm > 0.0 else 0.0
        seen = Witnesses.single(distance_mm, exact.on_tool_mm, exact.on_tumor_mm, exact.normal)
        return Proximity(exact.lower_bound_mm - 1e-9, seen, stamp)


@pytest.mark.parametrize("height_mm", [9.5, 10.0])
def test_sweep_uses_lower_bounds_and_touch_is_a_breach(height_mm):
    """8 mm along the top of the sphere: by the distances alone it could not be reached."""
    session = Session(replace(make_setup(), proximity=Vague(10.0)))
    for at_ms, x_mm in ((0, -4.0), (20, 4.0)):
        pose = tracker_from_cautery([x_mm, height_mm, 0.0])
        tool = valid(pose, at_ms)
        step = session.step(frame(at_ms, needle(at_ms), tool))
    assert distance_mm(step) == pytest.approx(height_mm - 10.0, abs=1e-9)
    assert step.decision.state is MarginState.POSITIVE


def test_margin_grows_with_age_over_a_single_missing_frame(session):
    steps(session, [30.0])
    step = session.step(frame(20, cautery_at(29.0, 20)))
    assert step.decision.state is MarginState.NEGATIVE
    assert step.decision.stamp == Stamp(0)
    assert step.decision.margin.age_mm == pytest.approx(50.0 * 0.020)


def test_latch_is_released_by_rearm_and_not_while_its_cause_lasts(session):
    steps(session, [30.0, 30.1])
    session.step(frame(40, needle(40), lost("tracker", "cautery", 40, TrackingStatus.MISSING)))
    with pytest.raises(NotRearmableError):
        session.rearm()
    *_, known = steps(session, [30.2, 30.3, 30.4], start_ms=60.0)
    assert (known.decision.state, known.decision.hold) == (MarginState.NEGATIVE, True)
    session.rearm()
    (free,) = steps(session, [30.5], start_ms=120.0)
    assert not free.decision.hold


def registered(touch, registration) -> RobotSetup:
    return RobotSetup(touch, "robot_base", "stylus", registration, DriftBound(5.0, 0.05))


def reference(at_ms: float) -> TrackedTransform:
    return sample("tracker", "reference", (1.0, 2.0, 3.0), at_ms)


def found_registration(noise_mm: float):
    points = np.random.default_rng(5).uniform(-60.0, 60.0, (8, 3))
    noisy = points + np.random.default_rng(6).normal(0.0, noise_mm, points.shape)
    return register_points(noisy, points, fixed_frame="reference", moving_frame="robot_base")


def test_registration_error_at_the_tip_widens_the_margin(touch):
    def tre_mm(noise_mm):
        session = Session(make_setup(registered(touch, found_registration(noise_mm))))
        return session.step(frame_at(0, 40.0, reference(0))).decision.margin.tre_mm

    assert tre_mm(0.3) > 0.1
    assert tre_mm(0.0) == pytest.approx(0.0, abs=1e-9)


class TouchingShaft(AnalyticSphere):
    """Test double: the tool touches with a point of its shaft, 130 mm behind the tip."""

    SHAFT_MM = np.array([0.0, 0.0, 130.0])

    def evaluate(self, tumor_from_tool, stamp=None):
        tip = super().evaluate(tumor_from_tool, stamp)
        points = (each + self.SHAFT_MM for each in (tip.on_tool_mm, tip.on_tumor_mm))
        return replace(tip, witnesses=Witnesses.single(tip.signed_distance_mm, *points, tip.normal))


def test_registration_error_counts_where_the_shaft_touches(touch):
    """The landmarks are around the tip: the registration's rotation errs more beside the shaft."""
    registration = found_registration(0.3)
    setup = make_setup(registered(touch, registration))
    steps = [
        Session(replace(setup, proximity=model(10.0))).step(frame_at(0, 40.0, reference(0)))
        for model in (AnalyticSphere, TouchingShaft)
    ]
    at_tip, at_shaft = (step.decision.margin.tre_mm for step in steps)
    points_mm = np.array([[40.0, 0.0, 0.0], [40.0, 0.0, 130.0]])
    in_reference_mm = (TRACKER_FROM_NEEDLE @ SENSOR_FROM_TUMOR).apply(points_mm) - [1.0, 2.0, 3.0]
    expected = predict_tre(registration, in_reference_mm)
    assert (at_tip, at_shaft) == pytest.approx(PARAMETERS.k_tre * expected)
    assert at_shaft > 1.5 * at_tip


@pytest.mark.parametrize(
    ("noise_mm", "more", "reason"),
    [(None, [sample("tracker", "reference", (1.0, 2.0, 3.0), 0)], Reason.REGISTRATION_MISSING),
     (0.1, [], Reason.MISSING)],
    ids=["no registration", "no reference"],
)  # fmt: skip
def test_robot_needs_its_registration_and_the_reference(touch, noise_mm, more, reason):
    registration = None if noise_mm is None else found_registration(noise_mm)
    session = Session(make_setup(registered(touch, registration)))
    step = session.step(frame_at(0, 40.0, *more))
    assert step.decision.state is MarginState.UNKNOWN
    assert reason in step.decision.reasons


def test_age_of_the_reference_counts_for_a_robot(touch):
    session = Session(make_setup(registered(touch, found_registration(0.0))))
    session.step(frame_at(0, 40.0, reference(0)))
    step = session.step(frame(100, needle(100), cautery_at(40.1, 100)))
    assert step.decision.stamp == Stamp(0)
    assert step.decision.margin.age_mm == pytest.approx(50.0 * 0.1)
    by_hand = Session(make_setup())
    by_hand.step(frame_at(0, 40.0, reference(0)))
    moved = needle(100).transform @ Transform("needle", "needle", np.eye(3), [0.0, 0.0, 1e-3])
    sample = valid(moved, 100)
    step = by_hand.step(frame(100, sample, cautery_at(40.1, 100)))
    assert step.decision.margin.age_mm == 0.0


@pytest.mark.parametrize("stuck", ["needle", "reference"])
def test_sensor_stuck_from_the_first_frame_on_is_no_fixed_transform(touch, stuck):
    session = Session(make_setup(registered(touch, found_registration(0.0))))
    for at_ms in range(0, 1101, 100):
        poses = {"needle": needle(at_ms), "reference": reference(at_ms)}
        moving = "reference" if stuck == "needle" else "needle"
        away = Transform(moving, moving, np.eye(3), [0.0, 0.0, 1e-3 * at_ms])
        pose = poses[moving].transform @ away
        poses[moving] = valid(pose, at_ms)
        tool = cautery_at(40.0 + 1e-3 * at_ms, at_ms)
        step = session.step(frame(at_ms, *poses.values(), tool))
    assert step.decision.state is MarginState.UNKNOWN
    assert Reason.FROZEN in step.decision.reasons


def test_links_follow_joints_and_are_empty_for_stale_or_wrong_joints(touch):
    given = given_registration(Transform.identity("reference", "robot_base"))
    session = Session(make_setup(registered(touch, given)))
    joints = dict.fromkeys(touch.actuated_joint_names, 0.2)
    poses = (reference(0), needle(0), cautery_at(40.0, 0))
    assert session.step(frame(0, *poses)).robot_problem == "no joint positions yet"
    step = session.step(frame(5, joints=(joint_sample(joints, 4),)))
    assert step.robot_problem == ""
    np.testing.assert_array_equal(
        step.links["stylus"].matrix, touch.forward_kinematics(joints)["stylus"].matrix
    )
    stale = session.step(frame(205))
    assert dict(stale.links) == {}
    assert stale.robot_problem == "joint positions are stale or from the future"
    ahead = session.step(frame(206, joints=(joint_sample(joints, 207),)))
    assert (dict(ahead.links), ahead.robot_problem) == (dict(stale.links), stale.robot_problem)
    wrong = session.step(frame(206, joints=(joint_sample({**joints, "waist": np.nan}, 206),)))
    assert not wrong.links
    assert "waist" in wrong.robot_problem
    del joints["roll"]
    fresh = Session(make_setup(registered(touch, given)))
    partly = fresh.step(frame(207, joints=(joint_sample(joints, 207),)))
    assert not partly.links
    assert "'roll', which moves 'stylus', has no position" in partly.robot_problem


def test_joints_of_a_robot_are_those_that_move_its_tool_link(touch):
    robot = RobotSetup(touch, "robot_base", "forearm", None, DriftBound(5.0, 0.05))
    assert robot.joint_names == {"waist", "shoulder", "elbow"}
    assert robot.is_posed_by(["waist", "shoulder", "elbow", "roll"])
    assert not robot.is_posed_by(["yaw", "pitch", "roll"])
    assert not robot.is_posed_by(["waist", "shoulder"])


def test_joints_of_another_device_do_not_replace_those_of_the_robot(touch):
    given = given_registration(Transform.identity("reference", "robot_base"))
    session = Session(make_setup(registered(touch, given)))
    arm = dict.fromkeys(touch.actuated_joint_names, 0.2)
    gripper = joint_sample({"finger": 0.01}, 1)
    poses = (reference(2), needle(2), cautery_at(40.0, 2))
    both = session.step(frame(2, *poses, joints=(joint_sample(arm, 0), gripper)))
    only_gripper = session.step(frame(200, joints=(gripper,)))
    for step in (both, only_gripper):
        assert step.robot_problem == ""
        assert step.links
        assert step.joints.as_mapping() == arm
    stale = session.step(frame(201, joints=(gripper,)))
    assert stale.robot_problem == "joint positions are stale or from the future"


def test_joints_of_another_device_are_not_those_of_a_robot_that_is_added(touch):
    session = Session(make_setup())
    arm, finger = dict.fromkeys(touch.actuated_joint_names, 0.2), {"finger": 0.01}
    assert session.single_source
    session.step(frame_at(0, 40.0, reference(0), joints=(joint_sample(finger, 0),)))
    given = given_registration(Transform.identity("reference", "robot_base"))
    session.use(replace(session.setup, robot=registered(touch, given)))
    assert not session.single_source
    both = (joint_sample(arm, 20), joint_sample(finger, 21))
    step = session.step(frame_at(21, 40.1, reference(21), joints=both))
    assert step.joints.as_mapping() == arm
    session.use(replace(session.setup, robot=None))
    assert session.single_source


def found_tool(touch, joints, shift_mm=0.0, turn_rad=0.0, at_ms=0):
    """The cautery away from where the robot's joints put it."""
    tip = touch.forward_kinematics(joints)["stylus"]
    turn = Transform.from_rotation_vector(
        [0.0, turn_rad, 0.0], [0.0, 0.0, 0.0], target="reference", source=tip.target
    )
    place = tip.translation_mm + np.array([shift_mm, 0.0, 0.0])
    seen = Transform("reference", "cautery_tip", (turn @ tip).rotation, place)
    pose = reference(at_ms).transform @ seen @ TOOL_FROM_TIP.inverse()
    return valid(pose, at_ms)


def drifting(touch, shift_mm, turn_rad=0.0, mounted=False):
    """A step whose tool is ``shift_mm`` away from its prediction."""
    joints = dict.fromkeys(touch.actuated_joint_names, 0.2)
    given = given_registration(Transform.identity("reference", "robot_base"))
    mount = Transform.identity("stylus", "cautery_tip") if mounted else None
    robot = RobotSetup(touch, "robot_base", "stylus", given, DriftBound(5.0, 0.05), mount)
    poses = (reference(0), needle(0), found_tool(touch, joints, shift_mm, turn_rad))
    return Session(make_setup(robot)).step(frame(0, *poses, joints=(joint_sample(joints, 0),)))


def test_tool_away_from_its_prediction_is_drift(touch):
    step = drifting(touch, 4.9)
    assert step.drift.translation_mm == pytest.approx(4.9)
    assert Reason.REGISTRATION_DRIFT not in step.decision.reasons
    step = drifting(touch, 5.1)
    assert step.decision.state is MarginState.UNKNOWN
    assert Reason.REGISTRATION_DRIFT in step.decision.reasons


def test_drift_persists_when_joint_states_stop(touch):
    session = Session(make_setup(registered(touch, found_registration(0.0))))
    joints = dict.fromkeys(touch.actuated_joint_names, 0.2)
    for at_ms in (0, 20, 40):
        cautery = cautery_at(40.0 + 0.1 * at_ms, at_ms)
        sample_of_joints = (joint_sample(joints, at_ms),) if at_ms == 0 else ()
        poses = (reference(at_ms), needle(at_ms), cautery)
        step = session.step(frame(at_ms, *poses, joints=sample_of_joints))
    step = session.step(frame(300, reference(300), needle(300), cautery_at(50.0, 300)))
    assert step.robot_problem != ""
    assert Reason.REGISTRATION_DRIFT in step.decision.reasons


def test_drift_ends_when_the_tool_is_at_its_prediction(touch):
    session = Session(make_setup(registered(touch, found_registration(0.0))))
    joints = dict.fromkeys(touch.actuated_joint_names, 0.2)
    for at_ms, off_mm in ((0, 6.0), (20, 0.0)):
        tool = found_tool(touch, joints, off_mm, at_ms=at_ms)
        poses = (reference(at_ms), needle(at_ms), tool)
        step = session.step(frame(at_ms, *poses, joints=(joint_sample(joints, at_ms),)))
        assert (Reason.REGISTRATION_DRIFT in step.decision.reasons) == (off_mm > 5.0)


def test_new_registration_resets_drift(touch):
    session = Session(make_setup(registered(touch, found_registration(0.0))))
    joints = (joint_sample(dict.fromkeys(touch.actuated_joint_names, 0.2), 0),)
    poses = (reference(0), needle(0), cautery_at(40.0, 0))
    step = session.step(frame(0, *poses, joints=joints))
    assert Reason.REGISTRATION_DRIFT in step.decision.reasons
    session.use(make_setup(registered(touch, found_registration(0.0))))
    poses = (reference(300), needle(300), cautery_at(50.0, 300))
    step = session.step(frame(300, *poses))  # without joint states
    assert Reason.REGISTRATION_DRIFT not in step.decision.reasons


def test_drift_follows_joints_and_a_registration_that_is_replaced_alone(touch):
    given = given_registration(Transform.identity("reference", "robot_base"))
    session = Session(make_setup(registered(touch, given)))

    def drift_mm(at_ms, angle):
        joints = dict.fromkeys(touch.actuated_joint_names, angle)
        tool = found_tool(touch, joints, 1.0, at_ms=at_ms)
        poses = (reference(at_ms), needle(at_ms), tool)
        step = session.step(frame(at_ms, *poses, joints=(joint_sample(joints, at_ms),)))
        return step.drift.translation_mm

    found_mm = [drift_mm(at_ms, 0.2 + 0.001 * at_ms) for at_ms in (0, 20, 40)]
    assert found_mm == pytest.approx([1.0, 1.0, 1.0])
    moved = Transform("reference", "robot_base", np.eye(3), [-3.0, 0.0, 0.0])
    robot = registered(touch, given_registration(moved))
    session.use(replace(session.setup, robot=robot))
    assert drift_mm(60, 0.26) == pytest.approx(4.0)


def test_rotation_is_drift_if_the_mount_is_known(touch):
    assert drifting(touch, 0.0, 0.06).drift.accepted, "how the tool is held is not known"
    assert drifting(touch, 0.0, 0.04, mounted=True).drift.accepted
    step = drifting(touch, 0.0, 0.06, mounted=True)
    assert step.drift.rotation_rad == pytest.approx(0.06)
    assert Reason.REGISTRATION_DRIFT in step.decision.reasons


@pytest.mark.parametrize("joint", [0.2, 0.7])
def test_drift_is_that_of_the_chain_of_transforms(touch, joint):
    """Registration, link and mount are turned and moved, and so is the tool by the tracker."""
    joints = {name: joint * (-0.8) ** n for n, name in enumerate(touch.actuated_joint_names)}
    base = Transform.from_rotation_vector(
        [0.4, -0.7, 0.2], [30.0, -20.0, 10.0], target="reference", source="robot_base"
    )
    mount = Transform.from_rotation_vector(
        [-0.3, 0.5, 0.9], [4.0, 5.0, -6.0], target="stylus", source="cautery_tip"
    )
    tool = found_tool(touch, joints, 3.0, 0.3)
    tip = reference(0).transform.inverse() @ tool.transform @ TOOL_FROM_TIP
    link = base.renamed(source=touch.root_link) @ touch.forward_kinematics(joints)["stylus"]
    for given_mount in (mount, None):
        robot = RobotSetup(
            touch,
            "robot_base",
            "stylus",
            given_registration(base),
            DriftBound(5.0, 0.05),
            given_mount,
        )
        poses = (reference(0), needle(0), tool)
        session = Session(make_setup(robot))
        step = session.step(frame(0, *poses, joints=(joint_sample(joints, 0),)))
        placed = (link if given_mount is None else link @ given_mount).renamed(source=tip.source)
        turned = 0.0 if given_mount is None else placed.angle_to(tip)
        assert step.drift.translation_mm == pytest.approx(placed.distance_mm_to(tip))
        assert step.drift.rotation_rad == pytest.approx(turned)
        assert step.drift.frame == "cautery_tip"


def test_mount_between_other_frames_is_an_error(touch):
    given = given_registration(Transform.identity("reference", "robot_base"))
    for target, source in (("base", "cautery_tip"), ("stylus", "needle_tip")):
        mount = Transform.identity(target, source)
        robot = RobotSetup(touch, "robot_base", "stylus", given, DriftBound(5.0, 0.05), mount)
        with pytest.raises(FrameError, match=f"{target}_from_{source}; expected stylus_from_caut"):
            make_setup(robot)


def test_invalid_robot_setup_is_rejected(touch):
    with pytest.raises(Exception, match="'gripper' is not a link of 'touch'"):
        RobotSetup(touch, "robot_base", "gripper", None, DriftBound(5.0, 0.05))
    with pytest.raises(Exception, match="expected reference_from_robot_base"):
        registered(touch, given_registration(Transform.identity("tracker", "robot_base")))


@pytest.mark.parametrize("base", ["reference", "needle", "tumor", "cautery", "cautery_tip"])
def test_base_named_like_another_frame_is_rejected(touch, base):
    robot = RobotSetup(touch, base, "stylus", None, DriftBound(5.0, 0.05))
    with pytest.raises(
        FrameError, match=f"robot.base_frame is '{base}'; expected a name of its own"
    ):
        SessionSetup(TOOL_FROM_TIP, SENSOR_FROM_TUMOR, AnalyticSphere(10.0), PARAMETERS, robot)


def test_robot_setup_compiles_kinematics_before_the_first_step(touch, monkeypatch):
    placed = []
    monkeypatch.setattr(Robot, "forward_kinematics", lambda _, positions: placed.append(positions))
    RobotSetup(touch, "robot_base", "stylus", None, DriftBound(5.0, 0.05))
    assert placed == [{}]


class Lump(AnalyticSphere):
    """Test double: the sphere in a frame of another name, for a tool in ``cautery_tip`` alone."""

    frames = ("lump", "cautery_tip")

    def __init__(self) -> None:
        super().__init__(10.0)


LOADED = """
import gc
from numba.core.dispatcher import Dispatcher
from app.session import Session
from tests.session.test_session import make_setup, steps

def loaded():
    found = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return {str(each): len(each.overloads) for each in found}

session = Session(make_setup())
before = loaded()
steps(session, [40.0, 39.0, 11.0])
assert sum(before.values()) > 5 and loaded() == before, (before, loaded())
"""


def test_steps_find_their_compiled_functions_loaded(project_root):
    """In an interpreter of its own: a forked one has loaded them already."""
    run_python("-c", LOADED, cwd=project_root)


def test_shapes_in_other_frames_are_rejected():
    with pytest.raises(FrameError, match=r"the tumour's shape is in 'lump'; expected 'tumor'"):
        SessionSetup(TOOL_FROM_TIP, SENSOR_FROM_TUMOR, Lump(), PARAMETERS, None)
    lump = Transform.identity("needle", "lump")
    with pytest.raises(FrameError, match=r"the tool's shape is in 'cautery_tip'; expected 'knife'"):
        SessionSetup(Transform.identity("cautery", "knife"), lump, Lump(), PARAMETERS, None)


def test_constraint_is_in_the_tumours_frame_for_any_name():
    lump = Transform("needle", "lump", SENSOR_FROM_TUMOR.rotation, [5.0, -4.0, 30.0])
    session = Session(SessionSetup(TOOL_FROM_TIP, lump, Lump(), PARAMETERS, None))
    (step,) = steps(session, [17.0])
    assert step.decision.constraint.frame == "lump"
    assert step.virtual_fixture.target == "lump"
    with pytest.raises(FrameError, match="frame is 'tumor'; expected 'lump'"):
        session.use(make_setup())


def test_uncertainty_of_the_tumour_widens_the_margin():
    plain = replace(make_setup(), tumor_sigma_mm=0.6)
    step = Session(plain).step(frame_at(0, 40.0, reference(0)))
    assert step.decision.margin.tre_mm == pytest.approx(PARAMETERS.k_tre * 0.6)


def test_uncertainty_of_tumour_and_registration_are_independent(touch):
    setup = make_setup(registered(touch, found_registration(0.3)))
    frames = (reference(0), needle(0), cautery_at(40.0, 0))
    alone = Session(setup).step(frame(0, *frames)).decision.margin.tre_mm
    both = Session(replace(setup, tumor_sigma_mm=0.6)).step(frame(0, *frames))
    expected = np.hypot(alone, PARAMETERS.k_tre * 0.6)
    assert both.decision.margin.tre_mm == pytest.approx(expected)
