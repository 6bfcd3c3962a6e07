"""Edges that a session knows at a step."""

import numpy as np
import pytest

from app.geometry import FrameError, Stamp, TrackingStatus, Transform
from app.registration import DriftBound, given_registration
from app.session import KnownEdges, RobotSetup, Session, SessionSetup
from tests.doubles import PARAMETERS, AnalyticSphere, frame, joint_sample, lost, sample


def turned(target, source, angle):
    return Transform.from_rotation_vector(
        (0.0, 0.0, angle), (1, 2, 3), target=target, source=source
    )


@pytest.fixture
def session(touch):
    registration = given_registration(turned("reference", "robot_base", 0.3))
    robot = RobotSetup(touch, "robot_base", "stylus", registration, DriftBound(1e6, 10.0))
    setup = SessionSetup(
        turned("cautery", "cautery_tip", 0.1),
        turned("needle", "tumor", 0.2),
        AnalyticSphere(10.0),
        PARAMETERS,
        robot,
    )
    return Session(setup)


def poses(at_ms):
    return [
        sample("tracker", name, (30.0 * k, 0.001 * at_ms, 5.0), at_ms)
        for k, name in enumerate(("needle", "cautery", "reference"))
    ]


def test_frames_are_connected_by_the_poses_of_the_step(session, touch):
    joints = dict.fromkeys(touch.actuated_joint_names, 0.2)
    session.step(frame(0, *poses(0)))
    step = session.step(frame(20, *poses(20), joints=(joint_sample(joints, 10),)))
    found, oldest = step.edges.between("tumor", "cautery_tip")
    np.testing.assert_allclose(found.matrix, step.tumor_from_tip.matrix, atol=1e-9)
    assert oldest == Stamp(20_000_000)
    link, oldest = step.edges.between("robot_base", "stylus")
    np.testing.assert_allclose(link.matrix, step.links["stylus"].matrix, atol=1e-9)
    assert oldest == Stamp(10_000_000)
    static, oldest = step.edges.between("robot_base", "reference")
    expected = session.setup.robot.registration.transform.inverse().matrix
    np.testing.assert_allclose(static.matrix, expected, atol=1e-9)
    assert oldest is None
    assert {"tracker", "needle", "tumor", "cautery_tip", "robot_base", "stylus"} <= (
        step.edges.frames()
    )


@pytest.mark.parametrize("how", ["lost", "stale", "future"])
def test_frame_of_an_unusable_sample_is_known_but_not_connected(session, how):
    session.step(frame(0, *poses(0)))
    needle, cautery, _ = poses(201)
    bad = {
        "lost": lost("tracker", "reference", 201, TrackingStatus.INVALID),
        "stale": None,
        "future": sample("tracker", "reference", (1, 1, 1), 500),
    }[how]
    step = session.step(frame(201, needle, cautery, *([] if bad is None else [bad])))
    assert "reference" in step.edges.frames()
    with pytest.raises(FrameError, match="'reference' in 'tracker' is not known now"):
        step.edges.between("tumor", "reference")
    assert step.edges.between("tumor", "cautery")[1] == Stamp(201_000_000)


def test_links_without_joints_are_known_but_not_connected(session):
    step = session.step(frame(0, *poses(0)))
    assert "stylus" in step.edges.frames()
    with pytest.raises(FrameError, match=r"'stylus' in '[a-z_]+' is not known now"):
        step.edges.between("robot_base", "stylus")


def test_edges_of_nothing_connect_nothing():
    with pytest.raises(FrameError, match="'b' is not connected with 'a' in the session"):
        KnownEdges().between("a", "b")
    assert KnownEdges().frames() == frozenset()
