"""Velocities of another process through the fixture: approach limited, everything doubtful none.

The tool's tip is the tumour's origin here, its one plane has +z as normal and lies 5 mm away.
"""

import json
import math
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.bridge.control import TwistLimiter
from app.bridge.tf import TransformBuffer
from app.fixture import LimiterParameters, MarginState, Reason
from app.geometry import Stamp, Transform
from app.session import Session, SessionSetup
from tests.bridge.conftest import DEADLINE_S, START_NS
from tests.doubles import PARAMETERS, AnalyticSphere, frame, sample

SENDER = Path(__file__).resolve().parent / "twist_sender.py"
LONG_NS = 10**12
MOST_M_S = 0.005 / 0.05
"""The whole clearance within the limiter's time constant."""


def asked(*linear, frame="tumor", late_s=0.0, angular=(0.0, 0.0, 0.0)):
    return json.dumps(
        {"frame": frame, "late_s": late_s, "linear": linear, "angular": list(angular)}
    )


@pytest.fixture
def buffer():
    """``turned`` has its x along the tumour's +z; ``old`` was last seen a second before."""
    known = TransformBuffer()
    half = math.sqrt(0.5)
    known.insert("tumor", "turned", 0, (0.0, 0.0, 0.0, 0.0, -half, 0.0, half), static=True)
    known.insert("tumor", "old", 1, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    return known


def answers(start_receiver, *commands):
    sender = start_receiver(*commands, script=SENDER)
    return sender.take(len(commands) + 1)


def zero(answer):
    return answer["linear"] == [0.0] * 3 and answer["angular"] == [0.0] * 3


def test_only_the_approach_is_limited_in_any_frame(ros, buffer, make_step, start_receiver):
    limiter = TwistLimiter(ros, buffer, timeout_ns=LONG_NS // 1000)
    step = make_step(0)
    still = np.zeros((1, 3))
    constraint = replace(step.decision.constraint, tumor_velocities_mm_s=still)
    limiter.allow(replace(step, decision=replace(step.decision, constraint=constraint)), LONG_NS)
    found = answers(
        start_receiver,
        asked(0.01, 0.02, 0.03),
        asked(0.01, 0.02, -1.0),
        asked(-1.0, 0.02, 0.01, frame="turned"),
        asked(0.01, 0.0, -0.05),
    )
    assert found[0]["linear"] == pytest.approx([0.01, 0.02, 0.03])
    # The plane holds the point (1, 2, 17.5) back: a turn of the tool helps too.
    point_m = np.array([0.001, 0.002, 0.0175])
    for answer, to_tumor in ((found[1], np.eye(3)), (found[2], turned_in_tumor())):
        linear = to_tumor @ np.array(answer["linear"])
        angular = to_tumor @ np.array(answer["angular"])
        approach = (linear + np.cross(angular, point_m))[2]
        assert approach == pytest.approx(-MOST_M_S, abs=1e-6)
    assert found[2]["frame"] == "turned"
    assert found[3]["linear"] == pytest.approx([0.01, 0.0, -0.05])
    assert zero(found[4])
    assert limiter.refused == {"no command comes any more": limiter.refused.total()}


def turned_in_tumor():
    """Columns: where ``turned`` has its axes in the tumour, by hand."""
    return np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])


def test_whatever_is_doubtful_gives_no_motion(ros, buffer, make_step, start_receiver):
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**9)
    limiter.allow(make_step(0), LONG_NS // 10**6)
    fresh = replace(make_step(0))
    limiter.allow(fresh, LONG_NS)
    found = answers(
        start_receiver,
        asked(0.0, 0.0, math.nan),
        asked(0.0, math.inf, 0.01),
        asked(0.0, 0.0, 0.01, angular=(math.nan, 0.0, 0.0)),
        asked(0.0, 0.0, 0.01, late_s=60.0),
        asked(0.0, 0.0, 0.01, late_s=-60.0),
        asked(0.0, 0.0, 0.01, frame="nowhere"),
        asked(0.0, 0.0, 0.01, frame=""),
        asked(0.0, 0.0, 1e306),
    )
    assert [zero(answer) for answer in found] == [True] * 9
    assert limiter.refused["a command is not finite"] == 4
    assert limiter.refused["a command is too old"] == 1
    assert limiter.refused["a command is from the future"] == 1
    assert limiter.refused["frame of a command"] == 2


def test_a_way_that_was_not_seen_lately_is_not_used(ros, buffer, make_step, start_receiver):
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**9)
    limiter.allow(make_step(0), 10**15)
    found = answers(start_receiver, asked(0.0, 0.0, 0.01, frame="old"))
    assert zero(found[0])


@pytest.mark.parametrize(
    ("stale_after_ns", "spent_ns"),
    [(3_000_000, 0), (LONG_NS, LONG_NS - 3_000_000)],
    ids=["as old as its oldest sample", "grown old since"],
)
def test_on_stale_data_nothing_moves(
    ros, buffer, make_step, start_receiver, stale_after_ns, spent_ns
):
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**9)
    limiter.allow(make_step(0), stale_after_ns, spent_ns)
    found = answers(start_receiver, asked(0.0, 0.0, -0.01), asked(0.01, 0.0, 0.02))
    assert [zero(answer) for answer in found] == [True] * 3
    assert limiter.refused["the constraint is stale"] == 2


def faulty(step, **changes):
    """``step`` with planes on hold because of a fault."""
    decision = step.decision
    changes = {"constraint": decision.constraint.held(), **changes}
    unknown = replace(
        decision, state=MarginState.UNKNOWN, reasons=(Reason.FROZEN,), hold=True, **changes
    )
    return replace(step, decision=unknown)


def earlier_planes(step):
    """The tool is seen where it is now; the planes are still those of before."""
    return faulty(step, constraint_is_current=False)


def of_the_future(step):
    return faulty(step, stamp=Stamp(step.frame.stamp.ns + 1))


@pytest.mark.parametrize(
    "spoilt",
    [
        earlier_planes,
        of_the_future,
        lambda step: faulty(step, stamp=None),
        lambda step: faulty(step, constraint=None, constraint_is_current=False),
        lambda step: replace(step, tumor_from_tip=None),
    ],
)
def test_planes_that_are_not_of_the_tool_as_it_is_now_allow_nothing(
    ros, buffer, make_step, start_receiver, spoilt
):
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**9)
    limiter.allow(make_step(0), LONG_NS)
    limiter.allow(spoilt(make_step(0)), LONG_NS)
    found = answers(start_receiver, asked(0.0, 0.0, -0.01), asked(0.0, 0.0, 0.01))
    assert [zero(answer) for answer in found] == [True] * 3
    assert limiter.refused["no constraint of now is known"] == 2


def test_on_hold_with_planes_of_now_it_may_retreat_and_not_approach(
    ros, buffer, make_step, start_receiver
):
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**9)
    limiter.allow(faulty(make_step(0)), LONG_NS)
    found = answers(start_receiver, asked(0.0, 0.0, -0.01), asked(0.01, 0.0, 0.02))
    point_m = np.array([0.001, 0.002, 0.0175])
    linear, angular = np.array(found[0]["linear"]), np.array(found[0]["angular"])
    assert (linear + np.cross(angular, point_m))[2] >= -1e-9
    assert found[1]["linear"] == pytest.approx([0.01, 0.0, 0.02])


def test_a_tool_that_went_through_the_tumor_can_leave_and_not_go_in_again(
    ros, buffer, start_receiver
):
    tip_mm = {"tracker": (-12.0, 0.0, 0.5), "beyond": (10.5, 0.0, 0.5)}
    setup = SessionSetup(
        Transform.identity("cautery", "cautery_tip"),
        Transform.identity("needle", "tumor"),
        AnalyticSphere(10.0),
        PARAMETERS,
        None,
    )
    session = Session(setup)
    for at_ms, where in ((0, "tracker"), (20, "beyond")):
        needle = sample("tracker", "needle", (0.0, 0.0, 0.001 * at_ms), at_ms)
        cautery = sample("tracker", "cautery", tip_mm[where], at_ms)
        step = session.step(frame(at_ms, needle, cautery))
    # Judged by the way through; the planes are those of the far side, where the tool is now.
    assert step.decision.state is MarginState.POSITIVE
    assert step.decision.proximity.on_tool_mm[0] < 0.0
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**9)
    limiter.allow(step, LONG_NS)
    found = answers(start_receiver, asked(0.02, 0.0, 0.0), asked(-0.01, 0.0, 0.0))
    out, back_in = found[0]["linear"], found[1]["linear"]
    # It is 0.51 mm away, 0.49 mm beyond the stop margin: driven out at 9.8 mm/s at the least.
    assert out == pytest.approx([0.02, 0.0, 0.0])
    assert back_in[0] >= 0.0097


def test_a_way_from_the_future_does_not_turn_a_command(ros, buffer, make_step, start_receiver):
    oldest_ns = START_NS - 3_000_000
    straight, half = (0.0,) * 6 + (1.0,), math.sqrt(0.5)
    around = (0.0, 0.0, 0.0, half, 0.0, 0.0, half)
    for name, ahead_ns in (("far", 900_000_000), ("near", 40_000_000)):
        buffer.insert("tumor", name, oldest_ns, straight)
        buffer.insert("tumor", name, oldest_ns + ahead_ns, around)
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**9)
    step, stale_after_ns = make_step(0), 60_000_000_000
    limiter.allow(step, stale_after_ns)
    commands = (asked(0.0, 0.02, 0.01, frame=name) for name in ("far", "near"))
    for answer in answers(start_receiver, *commands)[:2]:
        assert answer["linear"] == pytest.approx([0.0, 0.02, 0.01])
    buffer.insert("tumor", "later", oldest_ns + stale_after_ns + 1, around)
    (later, _) = answers(start_receiver, asked(0.0, 0.0, 0.01, frame="later"))
    assert zero(later)
    assert limiter.refused["way to the frame of a command"] == 1


def test_long_names_of_frames_are_not_kept_and_not_said(
    ros, buffer, make_step, start_receiver, capfd
):
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**9)
    limiter.allow(make_step(0), LONG_NS)
    names = [letter * length for length in (100_000, 257, 256) for letter in "abcd"]
    found = answers(start_receiver, *(asked(0.0, 0.0, 0.01, frame=name) for name in names))
    assert all(zero(answer) for answer in found)
    assert [answer["frame"] for answer in found[:12]] == [""] * 8 + names[8:]
    assert limiter.refused["frame of a command"] == 12
    assert len(capfd.readouterr().err) < 5_000


def test_no_command_is_answered_with_more_than_the_greatest_speed(
    ros, buffer, make_step, start_receiver
):
    limits = LimiterParameters(most_mm_s=100.0, most_rad_s=0.5)
    limiter = TwistLimiter(ros, buffer, parameters=limits, timeout_ns=10**9)
    limiter.allow(make_step(0), LONG_NS)
    found = answers(
        start_receiver, asked(0.0, 0.0, 1e9), asked(0.0, 0.0, 0.01, angular=(0.0, 0.0, 1.0))
    )
    assert found[0]["linear"] == pytest.approx([0.0, 0.0, 0.1])
    assert found[1]["linear"] == pytest.approx([0.0, 0.0, 0.005])
    assert found[1]["angular"] == pytest.approx([0.0, 0.0, 0.5])


def test_motion_ends_while_the_nodes_thread_is_stuck(ros, buffer, make_step, start_receiver):
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**8)
    limiter.allow(make_step(0), LONG_NS)
    start_receiver(asked(0.0, 0.0, 0.01), script=SENDER).take(1)
    stuck, free = threading.Event(), threading.Event()

    def hold_up():
        stuck.set()
        free.wait(DEADLINE_S)

    ros.call_soon(hold_up)
    assert stuck.wait(DEADLINE_S)
    said = limiter.refused["no command comes any more"]
    until_s = time.monotonic() + 10.0
    while limiter.refused["no command comes any more"] < said + 2 and time.monotonic() < until_s:
        threading.Event().wait(0.02)
    free.set()
    assert limiter.refused["no command comes any more"] >= said + 2


def test_before_the_first_step_nothing_moves(ros, buffer, start_receiver):
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**9)
    found = answers(start_receiver, asked(0.0, 0.0, 0.01))
    assert zero(found[0])
    assert limiter.refused["no constraint of now is known"] == 1
