"""Texts that tell why the session is on hold, and planes of a pose that may be wrong."""

from dataclasses import replace

import pytest

from app.fixture import POSE_DOUBTS, MarginState, Reason
from app.geometry import InputError, TrackingStatus, Transform
from app.hold import NotRearmableError
from app.hold.hold import MAX_CAUSES
from app.session import Session
from tests.session.test_session import cautery_at, frame, lost, make_setup, needle, steps


def good(session, at_ms, count=1):
    for index in range(count):
        now_ms = at_ms + 20 * index
        step = session.step(frame(now_ms, needle(now_ms), cautery_at(30.0 + 0.1 * index, now_ms)))
    return step


@pytest.fixture
def session():
    session = Session(make_setup())
    steps(session, [30.0, 30.1])
    return session


def test_no_hold_has_no_causes(session):
    assert good(session, 40).hold_causes == ()


def test_faults_are_listed_in_the_order_in_which_they_occurred_until_rearmed(session):
    gone = lost("tracker", "cautery", 40, TrackingStatus.INVALID)
    session.step(frame(40, needle(40), gone))
    session.step(frame(500))
    expected = (Reason.INVALID.text, Reason.STALE.text)
    step = good(session, 520, count=20)
    assert (step.decision.hold, step.hold_causes) == (True, expected)
    session.rearm()
    assert good(session, 940).hold_causes == ()


def test_causes_stay_when_rearming_is_refused(session):
    step = session.step(frame(500))
    with pytest.raises(NotRearmableError):
        session.rearm()
    assert session.step(frame(520)).hold_causes == step.hold_causes != ()


def test_hold_by_the_caller_has_its_text(session):
    session.hold("stop_mm lowered from 2 to 1")
    session.hold("stop_mm lowered from 2 to 1")
    assert good(session, 40).hold_causes == ("stop_mm lowered from 2 to 1",)


def test_fault_from_outside_is_a_fault_with_its_own_text(session):
    step = session.step(
        frame(40, needle(40), cautery_at(30.0, 40)),
        {Reason.SECOND_SENDER: "tracker -> needle has two senders"},
    )
    assert step.decision.reasons[0] is Reason.SECOND_SENDER
    assert step.frames_problem == "tracker -> needle has two senders"
    assert step.hold_causes == ("tracker -> needle has two senders",)


def test_the_first_causes_and_the_newest_are_kept(session):
    for number in range(20):
        session.hold(f"cause {number}")
    expected = [*(f"cause {number}" for number in range(MAX_CAUSES - 1)), "cause 19"]
    assert list(good(session, 40).hold_causes) == expected


def test_newest_fault_stays_listed_when_a_change_follows(session):
    for number in range(MAX_CAUSES):
        session.hold(f"cause {number}")
    margins = session.setup.margins
    session.use(replace(session.setup, margins=margins.replaced(stop_mm=margins.stop_mm / 2.0)))
    causes = good(session, 40).hold_causes
    assert len(causes) == MAX_CAUSES
    assert causes[-1] == f"cause {MAX_CAUSES - 1}"


AFTER_MS = range(60, 400, 20)


@pytest.mark.parametrize("doubt", sorted(POSE_DOUBTS))
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


@pytest.mark.parametrize("doubt", sorted(POSE_DOUBTS))
def test_a_doubt_before_the_first_clean_step_is_latched(doubt):
    """The fault, then good poses: an operator opens the fixture, not the first of them."""
    session = Session(make_setup())
    for at_ms in range(0, 400, 20):
        sample = frame(at_ms, needle(at_ms), cautery_at(30.0 + at_ms / 1000.0, at_ms))
        assert session.step(sample, {doubt: "a doubt"}).decision.state is MarginState.UNKNOWN
    step = good(session, 400)
    decision = step.decision
    assert (decision.hold, decision.constraint_is_current) == (True, False)
    assert step.hold_causes == ("a doubt", Reason.STARTING.text)
    session.rearm()
    decision = good(session, 420).decision
    assert (decision.hold, decision.constraint_is_current) == (False, True)


@pytest.mark.parametrize("seconds", [0, 5])
def test_no_data_before_the_first_clean_step_need_no_rearm(seconds):
    session = Session(make_setup())
    for at_ms in range(0, 1000 * seconds, 20):
        assert session.step(frame(at_ms)).decision.state is MarginState.UNKNOWN
    assert not good(session, 1000 * seconds).decision.hold


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


def test_step_that_fails_latches_the_hold_without_current_planes(session):
    """A reason that is no fault is a mistake of the caller, which the margin refuses."""
    sample = frame(40, needle(40), cautery_at(30.2, 40))
    with pytest.raises(InputError, match="expected faults"):
        session.step(sample, {Reason.WARNING_DISTANCE: "no fault"})
    assert session.latched
    with pytest.raises(NotRearmableError):
        session.rearm()
    step = good(session, 60)
    assert (step.decision.hold, step.decision.constraint_is_current) == (True, False)
    assert step.decision.constraint.hold
    assert step.hold_causes == ("a step has failed",)
    session.rearm()
    assert not good(session, 80).decision.hold


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
