"""What the documented rule of a controller makes of the received constraints."""

from collections.abc import Iterable

import numpy as np
from marginguard_msgs.msg import FixtureConstraint
from rclpy.serialization import deserialize_message

from app.bridge.plain_constraint import plain_constraint
from app.fixture import FixtureRule, RuleReason
from benchmarks.faults.controller import PUSH_MM_S
from benchmarks.faults.records import APPROACH_MM_S, Constraint
from benchmarks.faults.scene import Scene


def rule_approaches(constraints: Iterable[Constraint], scene: Scene, *, after_ns: int) -> int:
    """Number of messages sent after ``after_ns`` on which the rule allows an approach.

    The rule gets the messages in their order of arrival, and one control step follows each.
    """
    rule = FixtureRule(frame="tumor")
    count = 0
    for each in sorted(constraints, key=lambda one: one.arrived_ns):
        message = deserialize_message(each.content.raw, FixtureConstraint)
        message.seq = each.seq
        rule.receive(plain_constraint(message), each.arrived_ns)
        approach = scene.at(each.arrived_ns).approach
        desired = np.concatenate([PUSH_MM_S * approach, np.zeros(3)])
        tip = 1000.0 * _point(message)
        decision = rule.allow(desired, tip, each.arrived_ns)
        allowed = float(decision.twist[:3] @ approach) > APPROACH_MM_S
        count += allowed and each.sent_ns > after_ns and decision.reason is RuleReason.ALLOWED
    return count


def _point(message: FixtureConstraint) -> np.ndarray:
    """Point of the tool at the governing plane, (3,) m; it stands for the tip."""
    if not message.half_spaces:
        return np.zeros(3)
    point = message.half_spaces[0].point_on_tool
    return np.array([point.x, point.y, point.z])
