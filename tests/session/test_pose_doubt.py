"""No motion by the planes of a pose that may be wrong, until an operator re-arms."""

from dataclasses import replace

import pytest

from app.fixture import Reason
from app.geometry import TrackingStatus, Transform
from app.session import Session
from app.session.pose_doubt import DOUBTS
from tests.session.test_session import cautery_at, frame, lost, make_setup, needle, steps

AFTER_MS = range(60, 400, 20)


@pytest.fixture
def session():
    session = Session(make_setup())
    steps(session, [30.0, 30.1])
    return session


def good(session, at_ms):
    return session.step(frame(at_ms, needle(at_ms), cautery_at(30.0 + at_ms / 1e4, at_ms)))


@pytest.mark.parametrize("doubt", sorted(DOUBTS))
def test_no_planes_are_current_after_a_doubt_although_the_poses_are_good_again(session, doubt):
    assert good(session, 20).decision.constraint_is_current
    sample = frame(40, needle(40), cautery_at(30.1, 40))
    assert not session.step(sample, {doubt: "a doubt"}).decision.constraint_is_current
    for at_ms in AFTER_MS:
        decision = good(session, at_ms).decision
        assert (decision.hold, decision.constraint_is_current) == (True, False)
    session.rearm()
    decision = good(session, 400).decision
    assert (decision.hold, decision.constraint_is_current) == (False, True)


def test_planes_of_a_pose_that_was_only_lost_are_current_again(session):
    session.step(frame(40, needle(40), lost("tracker", "cautery", 40, TrackingStatus.INVALID)))
    decision = good(session, 60).decision
    assert (decision.hold, decision.constraint_is_current) == (True, True)


def test_pose_after_a_jump_gives_no_current_planes(session):
    """The sensor is believed again at its new place, and the jump itself lasts for one sample."""
    session.step(frame(40, needle(40), cautery_at(180.0, 40)))
    found = [
        session.step(frame(at_ms, needle(at_ms), cautery_at(180.0 + at_ms / 1e4, at_ms))).decision
        for at_ms in AFTER_MS
    ]
    assert Reason.IMPLAUSIBLE not in found[-1].reasons
    assert found[-1].proximity is not None
    assert not any(each.constraint_is_current for each in found)
    assert all(each.hold for each in found)


def test_hold_by_the_caller_doubts_the_pose_where_it_says_so(session):
    session.hold("a change")
    assert good(session, 40).decision.constraint_is_current
    session.hold("the last run was killed", doubt=True)
    assert not good(session, 60).decision.constraint_is_current
    session.rearm()
    assert good(session, 80).decision.constraint_is_current


def test_doubt_of_a_setup_that_is_replaced_stays(session):
    session.step(frame(40, needle(40), cautery_at(30.1, 40)), {Reason.CONTRADICTION: "a doubt"})
    session.use(replace(session.setup, margins=session.setup.margins.replaced(stop_mm=2.0)))
    assert not good(session, 60).decision.constraint_is_current


def test_no_motion_by_a_new_tumour_until_an_operator_has_agreed_to_it(session):
    tumor = session.setup.frame_from_tumor
    moved = Transform(tumor.target, tumor.source, tumor.rotation, tumor.translation_mm + 1.0)
    session.use(replace(session.setup, frame_from_tumor=moved))
    for at_ms in AFTER_MS:
        decision = good(session, at_ms).decision
        assert (decision.hold, decision.constraint_is_current) == (True, False)
    session.rearm()
    assert good(session, 400).decision.constraint_is_current
