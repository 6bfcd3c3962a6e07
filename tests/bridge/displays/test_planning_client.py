"""The plan that an arm executes, as displays get it."""

import pytest
from std_msgs.msg import String

from app.bridge import RosNode
from app.bridge.displays import ExecutedPlan
from app.bridge.topics import EXECUTED_PLAN
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


def test_plan_is_known_until_it_ends_or_its_node_leaves(ros, domain_id):
    texts = []
    with RosNode("executor", domain_id=domain_id) as executor:
        plans = executor.publisher(EXECUTED_PLAN)
        plans.publish(String(data="first"))
        ExecutedPlan(ros, texts.append)  # a display that begins later
        wait_until(lambda: texts == ["first"])
        plans.publish(String())
        wait_until(lambda: texts == ["first", ""])
        plans.publish(String(data="second"))
        wait_until(lambda: texts == ["first", "", "second"])
    wait_until(lambda: texts == ["first", "", "second", ""])


def test_plan_of_a_killed_node_ends_beside_another_one_that_executes_nothing(ros, domain_id):
    texts = []
    with RosNode("idle", domain_id=domain_id) as idle:
        idle.publisher(EXECUTED_PLAN).publish(String())
        with RosNode("executor", domain_id=domain_id) as executor:
            executor.publisher(EXECUTED_PLAN).publish(String(data="plan"))
            ExecutedPlan(ros, texts.append)
            wait_until(lambda: texts == ["plan"])
        wait_until(lambda: texts == ["plan", ""])
