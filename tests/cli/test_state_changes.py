"""Lines of ``marginguard live``: worse reasons at once, and few lines close to a threshold."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.case import TrackingFrame
from app.cli.live_lines import as_line, state_changes
from app.fixture import FixtureDecision, MarginState, Reason
from app.geometry import NS_PER_MS, NS_PER_S, Stamp
from app.session import StepResult, ToolDistance
from tests.doubles import Runner

FRAME_NS = 16 * NS_PER_MS
WARNING, UNKNOWN = MarginState.WARNING, MarginState.UNKNOWN


def step(decision: FixtureDecision, ns: int) -> StepResult:
    return StepResult(
        index=0,
        frame=TrackingFrame(Stamp(ns, "host"), ()),
        decision=decision,
        tumor_from_tip=None,
        virtual_fixture=None,
        links={},
        joints=None,
    )


def decided(*reasons: Reason, state: MarginState = WARNING, hold: bool = False) -> FixtureDecision:
    return FixtureDecision(
        state=state,
        reasons=reasons,
        proximity=None,
        margin=None,
        constraint=None,
        hold=hold,
        stamp=None,
        seq=0,
    )


def steps_of(decisions: Iterable[FixtureDecision], frame_ns: int = FRAME_NS) -> list[StepResult]:
    return [step(decision, index * frame_ns) for index, decision in enumerate(decisions)]


def printed_reasons(steps: Sequence[StepResult]) -> list[tuple[Reason, ...]]:
    return [step.decision.reasons for step in state_changes(steps)]


def test_trembling_at_warning_distance_is_printed_once():
    runner = Runner()
    distances = 5.0 + 0.02 * np.sin(np.arange(1200) * 1.7)
    steps = [
        step(runner.step(distance, advance_ns=FRAME_NS), runner.now_ns)
        for distance in distances.tolist()
    ]
    changes = sum(a.decision.reasons != b.decision.reasons for a, b in pairwise(steps))
    assert changes > 500  # of 19 s
    assert printed_reasons(steps)[-1] == (Reason.WARNING_DISTANCE,)
    assert len(printed_reasons(steps)) <= 2  # the first line may be CLEAR


@pytest.mark.parametrize(
    "worse",
    [
        decided(Reason.STOP_DISTANCE, Reason.WARNING_DISTANCE),
        decided(Reason.WARNING_DISTANCE, hold=True),
        decided(Reason.STALE, state=UNKNOWN),
    ],
)
def test_worse_reasons_of_one_frame_are_printed(worse):
    usual = decided(Reason.WARNING_DISTANCE)
    assert worse.reasons in printed_reasons(steps_of([usual, worse, usual, usual]))[1:]


def test_end_of_hold_is_printed_at_once():
    held = decided(Reason.WARNING_DISTANCE, Reason.LATCHED, hold=True)
    free = decided(Reason.WARNING_DISTANCE)
    assert printed_reasons(steps_of([held, held, free])) == [held.reasons, free.reasons]


def test_better_reasons_are_printed_after_minimum_duration():
    worse = decided(Reason.STOP_DISTANCE, Reason.WARNING_DISTANCE)
    better = decided(Reason.WARNING_DISTANCE)
    steps = steps_of([worse] + [better] * 200)
    late = list(state_changes(steps))[1]
    assert late.decision is better
    assert late.frame.stamp.ns == FRAME_NS + 2 * NS_PER_S
    assert len(printed_reasons(steps)) == 2


def test_clock_that_jumps_back_does_not_delay_better_reasons():
    worse = decided(Reason.STALE, Reason.LATCHED, state=UNKNOWN, hold=True)
    better = decided(Reason.RECOVERING, Reason.LATCHED, state=UNKNOWN, hold=True)
    hour_ns = 3600 * NS_PER_S
    steps = [step(worse, hour_ns), step(better, hour_ns + FRAME_NS)]
    steps += steps_of([better] * 200)
    assert printed_reasons(steps) == [worse.reasons, better.reasons]


@given(
    st.lists(
        st.tuples(
            st.sampled_from([WARNING, UNKNOWN]),
            st.booleans(),
            st.sets(st.sampled_from(list(Reason)[10:]), min_size=1, max_size=3),
            st.integers(1, 40),
        ),
        max_size=40,
    )
)
def test_last_line_is_never_better_than_present_reasons(runs):
    order = list(Reason)
    decisions = [
        decided(*sorted(reasons, key=order.index), state=state, hold=hold)
        for state, hold, reasons, times in runs
        for _ in range(times)
    ]
    steps = steps_of(decisions, NS_PER_S // 4)
    lines = {id(line) for line in state_changes(steps)}
    last, since_ns = None, 0
    for one in steps:
        now, ns = one.decision, one.frame.stamp.ns
        if id(one) in lines:
            last = now
        assert last is not None
        assert (last.state, last.hold) == (now.state, now.hold)
        # The printed reason is the present worst one, or a worse one for a limited time.
        assert order.index(last.reasons[0]) <= order.index(now.reasons[0])
        if last.reasons == now.reasons:
            since_ns = ns
        assert ns - since_ns <= 2 * NS_PER_S


@given(st.lists(st.booleans(), max_size=200), st.integers(1, NS_PER_S))
def test_two_alternating_reasons_print_at_most_one_line_per_second(turns, frame_ns):
    kinds = (decided(Reason.WARNING_DISTANCE), decided(Reason.RELEASING))
    lines = list(state_changes(steps_of([kinds[turn] for turn in turns], frame_ns)))
    assert len(lines) <= 2 + len(turns) * frame_ns / NS_PER_S


def test_near_tool_is_printed_at_once_and_a_clear_one_late():
    def with_tool(state: MarginState, number: int) -> StepResult:
        tool = ToolDistance("left", state, (Reason.STALE,))
        return replace(step(decided(Reason.CLEAR), number * FRAME_NS), tools=(tool,))

    states = [MarginState.NEGATIVE] * 5 + [WARNING, MarginState.NEGATIVE] * 50 + [UNKNOWN] * 5
    found = list(state_changes(map(with_tool, states, range(len(states)))))
    assert [each.tools[0].state for each in found] == [MarginState.NEGATIVE, WARNING, UNKNOWN]
    line = "WARNING: clear; distance of tool 'left' is not known (stale)"
    assert as_line(found[-1]) == line


def test_second_tool_that_comes_near_is_printed_at_once_while_the_first_leaves():
    def with_tools(number: int) -> StepResult:
        states = [MarginState.NEGATIVE, WARNING]
        names = ("left", "right") if number >= 5 else ("right", "left")
        tools = [ToolDistance(*each, ()) for each in sorted(zip(names, states, strict=True))]
        return replace(step(decided(Reason.CLEAR), number * FRAME_NS), tools=tuple(tools))

    found = list(state_changes(map(with_tools, range(10))))
    assert [[each.state for each in step.tools] for step in found] == [
        [WARNING, MarginState.NEGATIVE],
        [MarginState.NEGATIVE, WARNING],
    ]
