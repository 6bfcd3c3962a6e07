"""Guidance force received by another process: at the tip, along the tip's axes, in N."""

from dataclasses import replace

import numpy as np
import pytest

from app.bridge import topics
from app.bridge.live.outputs import GuidanceOutput
from app.fixture import GuidanceParameters
from app.geometry import Transform
from app.runtime import StepTiming
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
    guidance = GuidanceOutput(ros, QUICK)
    receiver = listening(ros, start_receiver, 1)
    step = rotated(make_step(0))
    guidance.publish(step, StepTiming())
    message = receiver.messages()[0]["message"]
    assert message["header"]["frame_id"] == "cautery_tip"
    stamp = message["header"]["stamp"]
    assert stamp["sec"] * 10**9 + stamp["nanosec"] == step.decision.stamp.ns
    force, torque = message["wrench"]["force"], message["wrench"]["torque"]
    # The plane is 5 mm away, half of the range; its normal is the tip's x-axis.
    assert [force[axis] for axis in "xyz"] == pytest.approx([2.0, 0.0, 0.0])
    assert [torque[axis] for axis in "xyz"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_force_beside_the_tip_gives_a_torque(ros, make_step, start_receiver):
    guidance = GuidanceOutput(ros, QUICK)
    receiver = listening(ros, start_receiver, 1)
    guidance.publish(make_step(0), StepTiming())
    torque = receiver.messages()[0]["message"]["wrench"]["torque"]
    # r x f with r = (1, 2, 17.5) mm and f = (0, 0, 2) N.
    assert [torque[axis] for axis in "xyz"] == pytest.approx([0.004, -0.002, 0.0])


@pytest.mark.parametrize(
    ("actions", "expected_n"),
    [
        # Nothing before the first pose; 1 N per period of 20 ms, also after 47 of them.
        (["lost 0", "seen 1", "seen 2", "lost 3", "lost 50", "lost 51"], [1.0, 2.0, 1.0, 0.0, 0.0]),
        (["seen 1", "seen 2", "earlier 3"], [1.0, 2.0, 1.0]),
        # Nothing at a rest before the first force; afterwards the ramp begins anew.
        (["rest 0", "seen 1", "seen 2", "rest 2", "seen 3"], [1.0, 2.0, 0.0, 1.0]),
    ],
    ids=["lost tool", "planes of an earlier pose", "rest"],
)
def test_force_fades_at_its_rate_and_is_zero_at_rest(
    ros, make_step, start_receiver, actions, expected_n
):
    guidance = GuidanceOutput(ros, replace(QUICK, rate_n_s=50.0))
    receiver = listening(ros, start_receiver, len(expected_n))
    for action, index in map(str.split, actions):
        step = make_step(int(index), lost=action == "lost")
        if action == "rest":
            guidance.end()
        elif action == "earlier":
            earlier = step.decision._replace(constraint_is_current=False)
            guidance.publish(replace(step, decision=earlier), StepTiming())
        else:
            guidance.publish(step, StepTiming())
    forces = [line["message"]["wrench"]["force"]["z"] for line in receiver.messages()]
    assert forces == pytest.approx(expected_n)
