"""The fault matrix: judging of messages, outcomes and selection of rows."""

import math
from dataclasses import replace

import pytest

from benchmarks.faults.records import Constraint, Content, Twist, judge
from benchmarks.faults.results import (
    RESIDUAL,
    SAFE,
    SINGLE_SOURCE,
    UNFLAGGED,
    UNMEASURED,
    UNSAFE,
    Row,
    RowResult,
    Variant,
)
from benchmarks.faults.run import all_rows, selected
from benchmarks.harness.peer import to_and_fro

pytestmark = pytest.mark.slow

MS = 1_000_000
LIMIT_MS = 60


def constraint(sent_ms, *, hold=False, state=0, valid_ms=60, reasons=("clear",)):
    content = Content(
        instance_id="a",
        stamp_ns=sent_ms * MS,
        valid_until_ns=(sent_ms + valid_ms) * MS,
        state=state,
        reasons=reasons,
        hold=hold,
        nonce=0,
        stop_mm=1.0,
        single_source=False,
        model_id="",
        raw=b"",
    )
    return Constraint(sent_ms * MS, sent_ms * MS, sent_ms, content)


def verdict(constraints, twists=()):
    made = [Twist(ms * MS, ms * MS, approach) for ms, approach in twists]
    return judge(constraints, made, begin_ns=0, limit_ns=LIMIT_MS * MS)


def held(sent_ms):
    return constraint(sent_ms, hold=True, reasons=("implausible", "latched"))


def test_hold_within_the_limit_is_safe():
    found = verdict([constraint(0), constraint(50), held(58), held(500)], [(40, 50.0), (70, 0.0)])
    assert (found.to_safe_ms, found.over_limit_ms) == (58.0, 0.0)
    assert (found.late_constraints, found.late_twists) == (0, 0)
    assert found.reasons == ("implausible", "latched")


def test_permissive_messages_after_limit_and_tolerance_are_late():
    found = verdict(
        [constraint(80), constraint(91), held(120)], [(85, 50.0), (110, 11.0), (115, 0.0)]
    )
    assert (found.late_constraints, found.late_twists) == (1, 1)
    assert found.over_limit_ms == 50.0
    assert found.to_safe_ms == 120.0


def test_last_message_decides_whether_the_session_became_safe():
    assert verdict([held(10), constraint(400)]).to_safe_ms is None
    assert verdict([held(10), held(400)], [(400, 20.0)]).to_safe_ms is None
    assert verdict([held(10), held(400)], [(400, math.nan)]).late_twists == 1


def test_expired_or_unknown_constraint_permits_nothing():
    expired = verdict([constraint(200, valid_ms=0)])
    assert (expired.late_constraints, expired.reasons) == (0, ("expired",))
    assert verdict([constraint(200, state=3)]).late_constraints == 0


def result(second_source, *verdicts, residual="no authentication"):
    row = Row(
        name="a",
        variant=Variant.NO_ROBOT,
        run=lambda bench: verdicts[0],
        second_source=second_source,
        bound="60 ms",
        residual=residual,
    )
    return RowResult(row, list(verdicts))


def test_outcome_of_a_row():
    good, bad = verdict([held(10)]), verdict([constraint(200)])
    assert result("joints", good, good).outcome == SAFE
    assert result("joints", good, bad).outcome == UNSAFE
    assert result("", bad).outcome == RESIDUAL
    assert result("joints").outcome == UNMEASURED
    assert [result("joints", good).passed, result("joints", bad).passed] == [True, False]
    assert [result("", bad).passed, result("joints").passed] == [True, False]


def test_single_source_must_be_flagged():
    bad = verdict([constraint(200)])
    flagged = replace(bad, single_source=True)
    assert result("", flagged, residual=SINGLE_SOURCE).outcome == RESIDUAL
    silent = result("", flagged, bad, residual=SINGLE_SOURCE)
    assert (silent.outcome, silent.passed) == (UNFLAGGED, False)


def test_rows_are_selected_by_text_or_wildcard():
    labels = [row.label for row in all_rows()]
    assert len(set(labels)) == len(labels)
    assert {row.name for row in selected(["creep"])} == {"creep 2 mm/s"}
    assert selected(["INVALID*"])[0].name == "INVALID"
    assert selected(["no such row"]) == []


def test_motion_has_no_repeated_frame():
    assert [to_and_fro(frame, 4) for frame in range(8)] == [0, 1, 2, 3, 2, 1, 0, 1]
