"""Velocity of a breathing tumour in the constraint, against the known truth."""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.case import MotionEntry, PlausibilityEntry
from app.fixture import MarginState, TumorMotionParameters
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    InputError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
)
from app.registration import DriftBound, given_registration
from app.robot import load_robot
from app.session import RobotSetup, Session, SessionSetup
from app.synthetic.motion import TOUCH_URDF
from tests.doubles import PARAMETERS, AnalyticSphere, frame, joint_sample, sample

pytestmark = pytest.mark.slow

EXPECTED = TumorMotionParameters(
    swing_mm=5.0, swing_rad=0.01, rate_hz=0.25, jitter_mm=0.1, jitter_rad=0.001
)
TOUCH = load_robot(TOUCH_URDF)
JOINTS = TOUCH.actuated_joint_names
PACE = 2.0 * math.pi * EXPECTED.rate_hz
SENSOR_FROM_TUMOR = Transform(
    "needle", "tumor", [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [3.0, 4.0, 5.0]
)


def make_setup(motion: TumorMotionParameters | None) -> SessionSetup:
    registration = given_registration(Transform.identity("reference", "robot_base"))
    robot = RobotSetup(TOUCH, "robot_base", "stylus", registration, DriftBound(1e6, 4.0))
    tip = Transform.identity("cautery", "cautery_tip")
    return SessionSetup(tip, SENSOR_FROM_TUMOR, AnalyticSphere(10.0), PARAMETERS, robot, motion)


def breath(at_ms: float, rng: np.random.Generator):
    """Tool and tumour in the reference; the needle swings by 5 mm along its own x."""
    x = 5.0 * math.sin(PACE * at_ms / 1000.0) + EXPECTED.jitter_mm * rng.normal()
    y, z = EXPECTED.jitter_mm * rng.normal(size=2)
    needle = Transform.from_rotation_vector(
        EXPECTED.jitter_rad * rng.normal(size=3), [x, y, z], target="reference", source="needle"
    )
    stamp = Stamp(round(at_ms * 1e6))
    return (
        TrackedTransform(needle, stamp, TrackingStatus.OK),
        sample("reference", "cautery", (60.0, 0.0, 0.001 * at_ms), at_ms),
    )


def joints(at_ms: float):
    """Joints at rest, so that the tracker is checked."""
    return (joint_sample(dict.fromkeys(JOINTS, 0.0), at_ms),)


def run(session: Session, start_ms: float, end_ms: float):
    rng = np.random.default_rng(round(start_ms))
    return [
        session.step(frame(at, *breath(at, rng), joints=joints(at)))
        for at in np.arange(start_ms, end_ms, 20.0)
    ]


def off_mm_s(steps):
    """Velocities of the constraint minus the true ones; the needle's x is the tumour's -y."""
    found = np.array([s.decision.constraint.tumor_velocities_mm_s[0] for s in steps])
    seconds = np.array([s.frame.stamp.ns / NS_PER_S for s in steps])
    true = np.zeros((len(steps), 3))
    true[:, 1] = -5.0 * PACE * np.cos(PACE * seconds)
    return found - true


def test_constraint_contains_the_tumours_velocity():
    followed = run(Session(make_setup(EXPECTED)), 0, 6000)[50:]
    assert {step.decision.state for step in followed} == {MarginState.NEGATIVE}
    still = run(Session(make_setup(None)), 0, 6000)[50:]
    assert not any(s.decision.constraint.tumor_velocities_mm_s.any() for s in still)
    # It moves at up to 7.9 mm/s.
    spread = np.sqrt((off_mm_s(followed) ** 2).mean(axis=0))
    assert spread.max() < 1.5 < 0.5 * np.sqrt((off_mm_s(still) ** 2).mean(axis=0)).max()


def test_tumour_without_fresh_samples_counts_as_still():
    session = Session(make_setup(EXPECTED))
    run(session, 0, 2000)
    silent = session.step(frame(2000 + PARAMETERS.stale_after_ns / 1e6))
    assert silent.decision.state is MarginState.UNKNOWN
    assert not silent.decision.constraint.tumor_velocities_mm_s.any()
    with pytest.raises(InputError, match="tumor_motion is given without a robot"):
        replace(make_setup(EXPECTED), robot=None)


def test_future_and_lost_samples_do_not_disturb_the_filter():
    session = Session(make_setup(EXPECTED))
    run(session, 0, 1000)
    ahead = breath(5000, np.random.default_rng(0))
    assert session.step(frame(1000, *ahead)).decision.state is MarginState.UNKNOWN
    assert np.abs(off_mm_s(run(session, 1020, 2000)[10:])).max() < 5.0


def test_clock_jump_or_new_shape_resets_the_filter():
    session = Session(make_setup(EXPECTED))
    run(session, 20_000, 21_000)
    assert off_mm_s(run(session, 0, 2000)[50:]).max() < 4.0
    session.use(replace(make_setup(EXPECTED), proximity=AnalyticSphere(9.0)))
    assert off_mm_s(run(session, 2000, 4000)[50:]).max() < 4.0


@pytest.mark.parametrize("what", ["place", "motion"])
def test_new_pose_or_motion_parameters_reset_the_filter(what):
    """Identical, to the last digit, to a session that starts with the new setup."""
    known = make_setup(EXPECTED)
    elsewhere = Transform("needle", "tumor", np.eye(3), [0.0, 100.0, 0.0])
    other = (
        replace(known, frame_from_tumor=elsewhere)
        if what == "place"
        else replace(known, tumor_motion=replace(EXPECTED, swing_mm=1.0))
    )
    session, fresh = Session(known), Session(other)
    run(session, 0, 1000)
    session.use(other)
    for ours, theirs in zip(run(session, 1000, 2000), run(fresh, 1000, 2000), strict=True):
        found, expected = ours.decision.constraint, theirs.decision.constraint
        np.testing.assert_array_equal(
            found.tumor_velocities_mm_s[0], expected.tumor_velocities_mm_s[0]
        )


def test_scattered_tumour_samples_count_as_still():
    """Limits of motion beyond the scatter: by default the session would not use it at all."""
    any_motion = PlausibilityEntry(motion=MotionEntry(1e9, 1e12, 1e9, 1e12))
    session = Session(replace(make_setup(EXPECTED), plausibility=any_motion))
    run(session, 0, 2000)
    rng = np.random.default_rng(3)
    for at in range(2000, 2000 + PARAMETERS.stale_after_ns // NS_PER_MS + 20, 20):
        needle = sample("reference", "needle", tuple(rng.uniform(-40.0, 40.0, 3)), at)
        tool = sample("reference", "cautery", (60.0, 0.0, 0.001 * at), at)
        decision = session.step(frame(at, needle, tool, joints=joints(at))).decision
        assert decision.constraint_is_current
    assert not decision.constraint.tumor_velocities_mm_s.any()


def test_tumour_velocity_is_bounded_by_v_max():
    """The tumour moves at up to 320 mm/s; the margin allows for 50."""
    session, bound = Session(make_setup(EXPECTED)), PARAMETERS.v_max_mm_s
    told = []
    for at in range(0, 2000, 20):
        away = -100.0 * max(0.0, (at - 400) / 1000.0) ** 2
        needle = sample("reference", "needle", (away, 0.0, 0.001 * at), at)
        tool = sample("reference", "cautery", (60, 0, 0.001 * at), at)
        step = session.step(frame(at, needle, tool, joints=joints(at)))
        constraint = step.decision.constraint
        told.append(float(constraint.normals[0] @ constraint.tumor_velocities_mm_s[0]))
    assert min(told) == pytest.approx(-bound)
