"""Guidance force received by another process: at the tip, along the tip's axes, in N."""

from dataclasses import replace

import numpy as np
import pytest

from app.bridge import topics
from app.bridge.control import GuidancePublisher
from app.fixture import GuidanceParameters
from app.geometry import Transform
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

QUICK = GuidanceParameters(
    force_n=4.0, range_mm=10.0, rate_n_s=1e6, period_s=0.02, delay_s=0.0, damping_n_s_m=10.0
)


def rotated(step):
    """Copy of ``step`` with the tip at (1, 2, 7.5) mm and its x along the tumour's +z."""
    rotation = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    pose = Transform("tumor", "cautery_tip", rotation, [1.0, 2.0, 7.5])
    return replace(step, tumor_from_tip=pose)


def listening(ros, start_receiver, count):
    """Receiver process that has been discovered, so that it gets every message from now on."""
    receiver = start_receiver(
        f"/marginguard/guidance_wrench:geometry_msgs/msg/WrenchStamped:{count}"
    )
    assert ros.wait_for_subscribers(topics.GUIDANCE_WRENCH, 1, timeout_s=DEADLINE_S)
    return receiver


def test_half_the_range_gives_half_the_force_along_the_tips_axes(ros, make_step, start_receiver):
    guidance = GuidancePublisher(ros, QUICK)
    receiver = listening(ros, start_receiver, 1)
    step = rotated(make_step(0))
    guidance.publish(step)
    message = receiver.messages()[0]["message"]
    assert message["header"]["frame_id"] == "cautery_tip"
    stamp = message["header"]["stamp"]
    assert stamp["sec"] * 10**9 + stamp["nanosec"] == step.decision.stamp.ns
    force, torque = message["wrench"]["force"], message["wrench"]["torque"]
    # The plane is 5 mm away, half of the range; its normal is the tip's x-axis.
    assert [force[axis] for axis in "xyz"] == pytest.approx([2.0, 0.0, 0.0])
    assert [torque[axis] for axis in "xyz"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_force_beside_the_tip_gives_a_torque(ros, make_step, start_receiver):
    guidance = GuidancePublisher(ros, QUICK)
    receiver = listening(ros, start_receiver, 1)
    guidance.publish(make_step(0))
    torque = receiver.messages()[0]["message"]["wrench"]["torque"]
    # r x f with r = (1, 2, 17.5) mm and f = (0, 0, 2) N.
    assert [torque[axis] for axis in "xyz"] == pytest.approx([0.004, -0.002, 0.0])


def test_force_fades_at_its_rate_when_the_tool_is_lost(ros, make_step, start_receiver):
    guidance = GuidancePublisher(ros, replace(QUICK, rate_n_s=50.0))
    receiver = listening(ros, start_receiver, 5)
    guidance.publish(make_step(0, lost=True))  # publishes nothing before the tool's first pose
    for index in (1, 2):
        guidance.publish(make_step(index))
    for index in (3, 50, 51):
        guidance.publish(make_step(index, lost=True))
    forces = [line["message"]["wrench"]["force"]["z"] for line in receiver.messages()]
    # 1 N per period of 20 ms, also after a gap of 47 periods.
    assert forces == pytest.approx([1.0, 2.0, 1.0, 0.0, 0.0])


def test_force_fades_with_planes_of_an_earlier_pose(ros, make_step, start_receiver):
    guidance = GuidancePublisher(ros, replace(QUICK, rate_n_s=50.0))
    receiver = listening(ros, start_receiver, 3)
    for index in (1, 2):
        guidance.publish(make_step(index))
    step = make_step(3)
    earlier = replace(step.decision, constraint_is_current=False)
    guidance.publish(replace(step, decision=earlier))
    forces = [line["message"]["wrench"]["force"]["z"] for line in receiver.messages()]
    assert forces == pytest.approx([1.0, 2.0, 1.0])


def test_rest_publishes_zero_force_and_restarts_the_ramp(ros, make_step, start_receiver):
    guidance = GuidancePublisher(ros, replace(QUICK, rate_n_s=50.0))
    receiver = listening(ros, start_receiver, 4)
    guidance.stop()  # publishes nothing, because no force has been published
    for index in (1, 2):
        guidance.publish(make_step(index))
    guidance.stop()
    guidance.publish(make_step(3))
    forces = [line["message"]["wrench"]["force"]["z"] for line in receiver.messages()]
    assert forces == pytest.approx([1.0, 2.0, 0.0, 1.0])
