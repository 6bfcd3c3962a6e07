"""Constraint message: SI units, and stamps of the samples behind the planes."""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.bridge.arm_inputs import setup_of
from app.bridge.constraint_message import ConstraintBuilder
from app.fixture import FixtureDecision, MarginState, Reason
from app.geometry import Transform

pytestmark = pytest.mark.slow


def ns(time):
    return time.sec * 10**9 + time.nanosec


def test_every_field_is_in_metres(content, make_step):
    step = make_step(0)
    message = ConstraintBuilder(content).message(step.decision)
    assert message.header.frame_id == "tumor"
    assert ns(message.header.stamp) == step.frame.stamp.ns - 3_000_000
    assert ns(message.valid_until) == ns(message.header.stamp) + 200_000_000
    assert message.state == message.NEGATIVE
    assert message.reasons == ["clear"]
    assert not message.hold
    assert message.signed_distance == 0.0075
    assert message.lower_bound == 0.00725
    assert message.stop_distance == pytest.approx(0.00175)
    assert message.warn_distance == pytest.approx(0.00575)
    assert message.sigma_tre == pytest.approx(0.00025)
    assert (message.model_id, message.registration_id) == (
        content.model_id,
        content.registration_id,
    )
    (plane,) = message.half_spaces
    assert (plane.normal.x, plane.normal.y, plane.normal.z) == (0.0, 0.0, 1.0)
    assert plane.offset == 0.0125
    point = plane.point_on_tool
    assert (point.x, point.y, point.z) == (0.001, 0.002, 0.0175)
    assert plane.tumor_velocity.y == 0.004
    assert (message.free_distance, message.free_turn) == (1.0, 10.0)
    assert message.max_tool_speed == pytest.approx(content.margins.v_max_mm_s / 1000.0)
    assert message.max_tool_turn == 2.0


def test_poses_of_tumor_and_base_are_those_in_use(content, make_step):
    builder, decision = ConstraintBuilder(content), make_step(0).decision
    first = builder.message(decision)
    base = content.registration.transform
    assert (first.tumor.header.frame_id, first.tumor.child_frame_id) == ("needle", "tumor")
    assert (first.base.header.frame_id, first.base.child_frame_id) == (base.target, base.source)
    assert first.base.transform.translation.x == pytest.approx(base.translation_mm[0] / 1000.0)
    turned = Transform("needle", "tumor", np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 5.0])
    edges = tuple(turned if e.source == "tumor" else e for e in content.static_edges)
    builder.use(replace(content, static_edges=edges))
    second = builder.message(decision)
    assert second.model_id == first.model_id
    assert second.setup_id != first.setup_id
    np.testing.assert_allclose(setup_of(second).frame_from_tumor.matrix, turned.matrix, atol=1e-12)
    by_hand = ConstraintBuilder(replace(content, robot=None)).message(decision)
    assert by_hand.base.child_frame_id == ""
    assert by_hand.setup_id != first.setup_id
    assert setup_of(by_hand).frame_from_base is None


@pytest.mark.parametrize("state", MarginState)
def test_states_have_the_constants_of_the_message(content, make_step, state):
    message = ConstraintBuilder(content).message(make_step(0, state=state).decision)
    assert message.state == getattr(message, state.name)


def test_unknown_state_keeps_old_planes_with_their_stamp(content, make_step):
    builder = ConstraintBuilder(content)
    good = builder.message(make_step(0).decision)
    message = builder.message(make_step(1, lost=True).decision)
    assert message.state == message.UNKNOWN
    assert message.hold
    assert message.reasons == ["invalid", "latched"]
    assert message.header.stamp == good.header.stamp
    assert message.valid_until == good.valid_until
    assert message.half_spaces == good.half_spaces
    for name in ("signed_distance", "lower_bound", "stop_distance", "warn_distance", "sigma_tre"):
        assert math.isnan(getattr(message, name)), name


def test_current_planes_have_the_current_stamp_even_if_unknown(content, make_step):
    """For example after a registration has drifted: the tracker's samples are still valid."""
    builder = ConstraintBuilder(content)
    builder.message(make_step(0).decision)
    step = make_step(1, state=MarginState.UNKNOWN)
    message = builder.message(step.decision)
    assert ns(message.header.stamp) == step.decision.stamp.ns


def test_stamp_of_another_tumor_is_not_used_for_the_new_one(content, make_step):
    builder = ConstraintBuilder(content)
    builder.message(make_step(0).decision)
    builder.use(content)
    decision = make_step(1, lost=True).decision._replace(constraint=None)
    message = builder.message(decision)
    assert ns(message.header.stamp) == ns(message.valid_until) == 0
    assert len(message.half_spaces) == 0


def test_constraint_before_the_first_valid_step_is_expired_and_on_hold(content, make_step):
    starting = FixtureDecision(
        state=MarginState.UNKNOWN,
        reasons=(Reason.STARTING,),
        proximity=None,
        margin=None,
        constraint=None,
        hold=True,
        stamp=make_step(0).decision.stamp,
        seq=0,
    )
    message = ConstraintBuilder(content).message(starting)
    assert message.hold
    assert len(message.half_spaces) == 0
    assert ns(message.header.stamp) == ns(message.valid_until) == 0
