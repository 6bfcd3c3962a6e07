"""A published constraint, received again, has the values of the decision."""

from dataclasses import replace

import numpy as np
import pytest
from marginguard_msgs.msg import FixtureConstraint

from app.bridge.constraint_message import ConstraintBuilder, plain_constraint
from app.fixture import FixtureRule, RulePermission, RuleReason

pytestmark = pytest.mark.slow


def test_values_equal_those_of_the_decision(content, make_step):
    step = make_step(3)
    message = ConstraintBuilder(content).message(step.decision)
    message.instance_id, message.seq = "one", 8
    found = plain_constraint(message)
    constraint = step.decision.constraint
    assert (found.instance_id, found.seq, found.frame) == ("one", 8, "tumor")
    assert found.stamp_ns == step.decision.stamp.ns
    assert found.valid_until_ns - found.stamp_ns == content.margins.stale_after_ns
    assert (found.state, found.hold) == (step.decision.state, False)
    for name in ("normals", "offsets_mm", "points_on_tool_mm", "tumor_velocities_mm_s"):
        np.testing.assert_allclose(getattr(found, name), getattr(constraint, name), rtol=1e-15)


def test_message_without_planes_allows_no_motion():
    rule = FixtureRule()
    empty = plain_constraint(FixtureConstraint(instance_id="one"))
    rule.receive(replace(empty, frame="tumor"), 0)
    decision = rule.allow(np.zeros(6), np.zeros(3), 0)
    assert (decision.permission, decision.reason) == (
        RulePermission.NO_MOTION,
        RuleReason.MALFORMED,
    )
