"""Change of a session's setup: no knowledge of the old setup is used with the new one."""

from dataclasses import replace

import pytest

from app.fixture import MarginState, Reason, TipProximity
from app.geometry import SurfaceMesh, Transform
from app.hold import NotRearmableError
from app.registration import given_registration
from app.session import Session, SessionSetup
from tests.doubles import PARAMETERS, AnalyticSphere, sample
from tests.doubles import frame as frame_of


@pytest.fixture
def session(case_setup):
    return Session(case_setup)


@pytest.fixture(scope="module")
def moved(case, case_setup):
    """The set-up with the tumour 3 mm away."""
    mesh = case.tumor_mesh()
    elsewhere = SurfaceMesh(mesh.frame, mesh.vertices_mm + 3.0, mesh.faces)
    return replace(case_setup, proximity=TipProximity(elsewhere))


def run(session, frames):
    return [session.step(frame) for frame in frames][-1].decision


def later(frame, **changes):
    """The frame a second later."""
    stamp = frame.stamp.shifted(10**9, frame.stamp.clock)
    poses = [replace(p, stamp=p.stamp.shifted(10**9, p.stamp.clock)) for p in frame.poses]
    return replace(frame, **{"stamp": stamp, "poses": tuple(poses), **changes})


def test_new_margins_apply_from_the_next_step_on(session, case_setup, case_frames):
    before = run(session, case_frames[:10])
    wider = case_setup.margins.replaced(stop_mm=20.0, warn_mm=100.0)
    session.use(replace(case_setup, margins=wider))
    after = session.step(case_frames[10]).decision
    assert before.margin.stop_mm == case_setup.margins.stop_mm
    assert (after.margin.stop_mm, after.margin.warn_mm) == (20.0, 100.0)


def test_shorter_stale_limit_applies_to_stored_poses(session, case_setup, case_frames):
    run(session, case_frames[:10])
    session.use(replace(case_setup, margins=case_setup.margins.replaced(stale_after_ns=1)))
    assert Reason.STALE in session.step(replace(case_frames[11], poses=())).decision.reasons


def test_session_with_another_tumor_equals_a_new_session(session, moved, case_frames):
    fresh = Session(moved)
    run(session, case_frames[:10])
    session.use(moved)
    for frame in case_frames[10:30]:
        ours, theirs = session.step(frame).decision, fresh.step(frame).decision
        assert ours.state is theirs.state
        assert ours.proximity.signed_distance_mm == theirs.proximity.signed_distance_mm
        assert ours.constraint.offsets_mm.tolist() == theirs.constraint.offsets_mm.tolist()


def test_state_is_unknown_until_the_new_tumor_is_evaluated(session, moved, case_frames):
    run(session, case_frames[:10])
    session.use(moved)
    decision = session.step(
        later(case_frames[10], poses=(), joints=case_frames[10].joints)
    ).decision
    assert decision.state is MarginState.UNKNOWN
    assert decision.constraint is None
    assert decision.hold


@pytest.mark.parametrize("what", ["tumour", "tool", "registration"])
def test_change_of_setup_latches_hold_until_rearm(session, case_setup, moved, case_frames, what):
    tip, robot = case_setup.tool_from_tip, case_setup.robot
    there = Transform(tip.target, tip.source, tip.rotation, tip.translation_mm + 0.1)
    given = given_registration(robot.registration.transform)
    changed = {
        "tumour": moved,
        "tool": replace(case_setup, tool_from_tip=there),
        "registration": replace(case_setup, robot=replace(robot, registration=given)),
    }[what]
    for frame in case_frames[:10]:
        assert not session.step(frame).decision.hold
    session.use(changed)
    with pytest.raises(NotRearmableError):
        session.rearm()
    for frame in case_frames[10:15]:
        known = session.step(frame).decision
        assert known.state is not MarginState.UNKNOWN
        assert known.hold
        assert Reason.LATCHED in known.reasons
    session.rearm()
    assert not session.step(case_frames[15]).decision.hold


def test_new_tool_that_never_moves_is_frozen():
    identity, sphere = Transform.identity, AnalyticSphere(10.0)
    with_cautery = SessionSetup(
        identity("cautery", "tip"), identity("needle", "tumor"), sphere, PARAMETERS, None
    )
    session = Session(with_cautery)
    session.use(replace(with_cautery, tool_from_tip=identity("drill", "tip")))
    for at_ms in range(0, 1101, 100):
        tumor = sample("tracker", "needle", (0.0, 0.0, 0.001 * at_ms), at_ms)
        drill = sample("tracker", "drill", (40.0, 0.0, 0.0), at_ms)
        reasons = session.step(frame_of(at_ms, tumor, drill)).decision.reasons
    assert Reason.FROZEN in reasons


def test_new_margins_do_not_latch_hold(session, case_setup, case_frames):
    run(session, case_frames[:10])
    session.use(replace(case_setup, margins=case_setup.margins.replaced(stop_mm=2.0)))
    assert not session.step(case_frames[10]).decision.hold


def test_latched_hold_survives_a_change_of_tumor(session, moved, case_frames):
    run(session, case_frames[:5])
    session.step(later(case_frames[5], poses=()))
    session.use(moved)
    decision = run(session, [later(frame, joints=()) for frame in case_frames[6:30]])
    assert decision.hold
    assert Reason.LATCHED in decision.reasons
