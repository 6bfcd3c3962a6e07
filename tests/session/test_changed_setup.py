"""Change of a session's setup: no knowledge of the old setup is used with the new one."""

from dataclasses import replace

import pytest

from app.case import open_case
from app.fixture import MarginState, NotRearmableError, Reason, TipProximity
from app.geometry import SurfaceMesh, Transform
from app.registration import given_registration
from app.session import Session, SessionSetup, setup_from_case
from tests.doubles import PARAMETERS, AnalyticSphere, sample
from tests.doubles import frame as frame_of


@pytest.fixture(scope="module")
def case(project_root):
    return open_case(project_root / "data" / "recorded_case")


@pytest.fixture(scope="module")
def setup(case):
    return setup_from_case(case, tip_only=True)


@pytest.fixture(scope="module")
def frames(case):
    frames = case.frames()
    return [next(frames) for _ in range(30)]


def moved(mesh, by_mm):
    return SurfaceMesh(mesh.frame, mesh.vertices_mm + by_mm, mesh.faces)


def test_new_margins_apply_from_the_next_step_on(setup, frames):
    session = Session(setup)
    before = [session.step(frame) for frame in frames[:10]][-1]
    wider = setup.margins.replaced(stop_mm=20.0, warn_mm=100.0)
    session.use(replace(setup, margins=wider))
    after = session.step(frames[10])
    assert before.decision.margin.stop_mm == setup.margins.stop_mm
    assert after.decision.margin.stop_mm == 20.0
    assert after.decision.margin.warn_mm == 100.0


def test_shorter_stale_limit_applies_to_stored_poses(setup, frames):
    session = Session(setup)
    for frame in frames[:10]:
        session.step(frame)
    session.use(replace(setup, margins=setup.margins.replaced(stale_after_ns=1)))
    silent = replace(frames[11], poses=())
    assert Reason.STALE in session.step(silent).decision.reasons


def test_session_with_another_tumor_equals_a_new_session(case, setup, frames):
    other = replace(setup, proximity=TipProximity(moved(case.tumor_mesh(), 3.0)))
    session, fresh = Session(setup), Session(other)
    for frame in frames[:10]:
        session.step(frame)
    session.use(other)
    for frame in frames[10:]:
        ours, theirs = session.step(frame).decision, fresh.step(frame).decision
        assert ours.state is theirs.state
        assert ours.proximity.signed_distance_mm == theirs.proximity.signed_distance_mm
        assert ours.constraint.offsets_mm.tolist() == theirs.constraint.offsets_mm.tolist()


def test_state_is_unknown_until_the_new_tumor_is_evaluated(case, setup, frames):
    session = Session(setup)
    for frame in frames[:10]:
        session.step(frame)
    session.use(replace(setup, proximity=TipProximity(moved(case.tumor_mesh(), 3.0))))
    late = frames[10].stamp.shifted(10**9, frames[10].stamp.clock)
    decision = session.step(replace(frames[10], stamp=late, poses=())).decision
    assert decision.state is MarginState.UNKNOWN
    assert decision.constraint is None
    assert decision.hold


def changed(case, setup, what):
    if what == "tumour":
        return replace(setup, proximity=TipProximity(moved(case.tumor_mesh(), 3.0)))
    if what == "tool":
        tip = setup.tool_from_tip
        there = Transform(tip.target, tip.source, tip.rotation, tip.translation_mm + 0.1)
        return replace(setup, tool_from_tip=there)
    given = given_registration(setup.robot.registration.transform)
    return replace(setup, robot=replace(setup.robot, registration=given))


@pytest.mark.parametrize("what", ["tumour", "tool", "registration"])
def test_change_of_setup_latches_hold_until_rearm(case, setup, frames, what):
    session = Session(setup)
    for frame in frames[:10]:
        assert not session.step(frame).decision.hold
    session.use(changed(case, setup, what))
    with pytest.raises(NotRearmableError):
        session.rearm()
    for frame in frames[10:15]:
        known = session.step(frame).decision
        assert known.state is not MarginState.UNKNOWN
        assert known.hold
        assert Reason.LATCHED in known.reasons
    session.rearm()
    assert not session.step(frames[15]).decision.hold


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


def test_new_margins_do_not_latch_hold(setup, frames):
    session = Session(setup)
    for frame in frames[:10]:
        session.step(frame)
    session.use(replace(setup, margins=setup.margins.replaced(stop_mm=2.0)))
    assert not session.step(frames[10]).decision.hold


def test_latched_hold_survives_a_change_of_tumor(case, setup, frames):
    session = Session(setup)
    for frame in frames[:5]:
        session.step(frame)
    late = frames[5].stamp.shifted(10**9, frames[5].stamp.clock)
    session.step(replace(frames[5], stamp=late, poses=()))
    session.use(replace(setup, proximity=TipProximity(moved(case.tumor_mesh(), 3.0))))
    decision = None
    for frame in frames[6:]:
        shifted = [
            replace(sample, stamp=sample.stamp.shifted(10**9, sample.stamp.clock))
            for sample in frame.poses
        ]
        stamp = frame.stamp.shifted(10**9, frame.stamp.clock)
        decision = session.step(
            replace(frame, stamp=stamp, poses=tuple(shifted), joints=())
        ).decision
    assert decision.hold
    assert Reason.LATCHED in decision.reasons
