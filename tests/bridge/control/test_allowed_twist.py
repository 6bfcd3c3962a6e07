"""Velocities of another process through the fixture: approach limited, everything doubtful none.

The tool's tip is the tumour's origin here, its one plane has +z as normal and lies 5 mm away.
"""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.bridge.control import TwistLimiter
from app.bridge.tf import TransformBuffer

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


def test_on_stale_data_it_may_retreat_and_not_approach(ros, buffer, make_step, start_receiver):
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**9)
    limiter.allow(make_step(0), 0)
    found = answers(start_receiver, asked(0.0, 0.0, -0.01), asked(0.01, 0.0, 0.02))
    point_m = np.array([0.001, 0.002, 0.0175])
    linear, angular = np.array(found[0]["linear"]), np.array(found[0]["angular"])
    assert (linear + np.cross(angular, point_m))[2] >= -1e-9
    assert found[1]["linear"] == pytest.approx([0.01, 0.0, 0.02])
    assert limiter.refused["the constraint is stale"] == 2


def test_before_the_first_step_nothing_moves(ros, buffer, start_receiver):
    limiter = TwistLimiter(ros, buffer, timeout_ns=10**9)
    found = answers(start_receiver, asked(0.0, 0.0, 0.01))
    assert zero(found[0])
    assert limiter.refused["no constraint is known yet"] == 1
