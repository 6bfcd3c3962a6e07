"""The hold as a state machine: what latches it, its causes, the doubt of the pose, its end."""

import numpy as np
import pytest

from app.fixture import POSE_DOUBTS, Constraint, FixtureDecision, MarginState, Reason, worst_first
from app.hold import Hold, NotRearmableError
from app.hold.hold import MAX_CAUSES

PLANE = Constraint("tumor", [[0, 0, 1]], [5], [[0, 0, 8]], [[0, 0, 3]], hold=False)
FAULTS = [reason for reason in Reason if reason.is_fault]
LASTING = sorted({*FAULTS} - {Reason.STARTING, Reason.RECOVERING})


def decision(*reasons: Reason) -> FixtureDecision:
    """The decision of a monitor for these reasons: its hold is that of UNKNOWN alone."""
    unknown = any(reason.is_fault for reason in reasons)
    return FixtureDecision(
        state=MarginState.UNKNOWN if unknown else MarginState.NEGATIVE,
        reasons=worst_first(reasons or (Reason.CLEAR,)),
        proximity=None,
        margin=None,
        constraint=PLANE.on_hold() if unknown else PLANE,
        hold=unknown,
        stamp=None,
        seq=1,
        constraint_is_current=not unknown,
    )


def running() -> Hold:
    hold = Hold()
    assert hold.applied(decision(Reason.STARTING, Reason.MISSING), {}).hold
    assert not hold.applied(decision(), {}).hold
    return hold


@pytest.mark.parametrize("fault", LASTING)
def test_a_fault_after_the_start_latches_until_the_rearm(fault):
    hold = running()
    assert Reason.LATCHED in hold.applied(decision(fault), {}).reasons
    with pytest.raises(NotRearmableError):
        hold.rearm()
    held = hold.applied(decision(), {})
    assert (held.hold, held.constraint.hold, held.state) == (True, True, MarginState.NEGATIVE)
    assert held.reasons == (Reason.LATCHED, Reason.CLEAR)
    assert np.array_equal(held.constraint.rows, PLANE.rows)  # with the velocity of the tumour
    assert held.constraint_is_current == (fault not in POSE_DOUBTS)
    assert hold.causes == (fault.text,)
    hold.rearm()
    released = decision()
    assert hold.applied(released, {}) is released
    assert hold.causes == ()


@pytest.mark.parametrize("fault", LASTING)
def test_before_the_first_evaluation_only_a_doubt_of_the_pose_latches(fault):
    hold = Hold()
    hold.applied(decision(Reason.STARTING, fault), {})
    assert hold.latched == hold.applied(decision(), {}).hold == (fault in POSE_DOUBTS)


def test_recovering_alone_latches_nothing_and_is_no_cause():
    hold = running()
    assert hold.applied(decision(Reason.RECOVERING), {}).hold
    assert (hold.latched, hold.causes) == (False, ())


def test_restart_latches_after_a_known_margin_and_bars_the_rearm_until_the_next_decision():
    fresh, hold = Hold(), running()
    fresh.restart()
    hold.restart()
    assert (fresh.latched, hold.latched) == (False, True)
    with pytest.raises(NotRearmableError):
        hold.rearm()
    hold.applied(decision(), {})
    hold.rearm()


def test_doubt_lasts_as_long_as_the_hold():
    hold = running()
    hold.latch("restarted", doubt=True)
    assert not hold.applied(decision(), {}).constraint_is_current
    hold.rearm()
    assert hold.applied(decision(), {}).constraint_is_current
    hold.latch("again")
    assert hold.applied(decision(), {}).constraint_is_current
    hold.doubt()
    assert not hold.applied(decision(), {}).constraint_is_current


def test_changes_come_before_faults_of_which_the_first_and_the_newest_are_kept():
    hold = running()
    for number in range(20):
        hold.latch(f"fault {number}")
    assert hold.causes == (*(f"fault {number}" for number in range(MAX_CAUSES - 1)), "fault 19")
    hold.change(["stop_mm lowered", "tumour replaced"], latch=True)
    assert len(hold.causes) == MAX_CAUSES
    assert hold.causes[:3] == ("stop_mm lowered", "tumour replaced", "fault 0")
    assert hold.causes[-1] == "fault 19"


def test_a_change_explains_the_measurement_anew():
    hold = running()
    hold.change(["tumour replaced"], latch=True)
    hold.restart()
    hold.applied(decision(Reason.STARTING), {})
    assert hold.causes == ("tumour replaced",)


def test_the_text_of_the_caller_names_a_fault():
    hold = running()
    hold.applied(decision(Reason.SECOND_SENDER), {Reason.SECOND_SENDER: "process 7 sends too"})
    assert hold.causes == ("process 7 sends too",)


def test_a_step_that_fails_latches_and_bars_the_rearm():
    hold = running()
    hold.latch_by_error()
    with pytest.raises(NotRearmableError):
        hold.rearm()
    held = hold.applied(decision(), {})
    assert (held.hold, held.constraint_is_current) == (True, False)
    assert hold.causes == ("a step has failed",)


def test_tightening_does_not_latch():
    hold = running()
    hold.change([], latch=False)
    assert not hold.applied(decision(), {}).hold
