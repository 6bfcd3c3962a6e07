import math
from types import SimpleNamespace

import numpy as np
import pytest

from app.case import Activation
from app.fixture import AppliedMargin, FixtureDecision, MarginState, Proximity, Reason, Witnesses
from app.geometry import Stamp, Transform
from app.report import ReplayLog, ReportError, ReportRow
from app.runtime import StepTiming


def step(distance_mm, *, ns=5, tip=True, activation=None):
    proximity = None
    if distance_mm is not None:
        witnesses = Witnesses.single(
            distance_mm, np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 1.0])
        )
        proximity = Proximity(distance_mm - 0.1, witnesses, None)
    known = distance_mm is not None
    decision = FixtureDecision(
        MarginState.POSITIVE if known else MarginState.UNKNOWN,
        (Reason.CONTACT, Reason.INSIDE) if known else (Reason.INVALID,),
        proximity,
        AppliedMargin(1.0, 5.0, 0.5, 0.25) if known else None,
        None,
        False,
        Stamp(ns),
        1,
    )
    tip_pose = Transform("tumor", "cautery_tip", np.eye(3), np.array([1.0, 2.0, 3.0]))
    made = SimpleNamespace(
        frame=SimpleNamespace(stamp=Stamp(ns), activation=activation),
        decision=decision,
        tumor_from_tip=tip_pose if tip else None,
        between_frames=None,
        structures=(),
        tools=(),
    )
    made.of_tumor = made
    return made


def test_row_of_a_step_keeps_its_numbers():
    row = ReportRow.from_step(step(-1.5))
    assert row == ReportRow(
        5, MarginState.POSITIVE, ("contact", "inside"), -1.5, -1.6, (1.0, 2.0, 3.0), 1.75, 5.75
    )
    assert row.inside
    assert ReportRow.from_step(step(-1.5, activation=Activation.ON)).activation is Activation.ON


def test_row_of_a_step_without_proximity_has_no_numbers():
    row = ReportRow.from_step(step(None, tip=False))
    assert row == ReportRow(5, MarginState.UNKNOWN, ("invalid",))
    assert not row.inside


def test_distance_that_is_not_finite_is_none():
    row = ReportRow.from_step(step(math.nan))
    assert row.signed_distance_mm is None
    assert row.lower_bound_mm is None


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_row_refuses_numbers_that_are_not_finite(value):
    with pytest.raises(ReportError, match=r"row at 7 ns: (nan|inf); expected finite numbers"):
        ReportRow(7, MarginState.NEGATIVE, (), value)


def test_log_keeps_the_deepest_step_only():
    log = ReplayLog()
    steps = [step(distance) for distance in (None, 3.0, None, -2.0, -1.0)]
    for number, one in enumerate(steps):
        log.publish(one, StepTiming(duration_ns=100 + number))
        assert log.deepest is (None, *steps[1:2] * 2, *steps[3:4] * 2)[number]
    assert log.durations_ns == [100, 101, 102, 103, 104]
    assert [row.signed_distance_mm for row in log.rows] == [None, 3.0, None, -2.0, -1.0]
