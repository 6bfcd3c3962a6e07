"""Joysticks and haptic devices of another process as the hand of a world."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.bridge import RosNode
from app.bridge.simulation import NODE_NAME, DeviceHand, JoyInput, SimulationNode
from app.simulation import World, open_world

pytestmark = pytest.mark.slow

PEER = Path(__file__).with_name("hand_peer.py")
ROUNDS = 3000


@pytest.fixture
def description(project_root):
    return open_world(project_root / "data" / "worlds" / "lumpectomy")


@pytest.fixture
def ros(domain_id):
    with RosNode(NODE_NAME, domain_id=domain_id) as node:
        yield node


@pytest.fixture
def peer(start):
    found = start(PEER)
    found.line()
    return found


def round_until(peer, condition, command):
    """Send ``command`` again and again until ``condition`` of the peer's answer holds."""
    for _ in range(ROUNDS):
        peer.send(json.dumps(command))
        seen = json.loads(peer.line())
        if condition(seen):
            return seen
    pytest.fail(f"not within {ROUNDS} rounds: {seen}")


def test_joystick_pushes_the_tool(ros, peer, description, start):
    hand = JoyInput(ros, description.hand.joy, "cautery", 10.0).hand
    world = World(description)
    node = SimulationNode(ros, description, hand=hand)

    def force():
        return hand.wrench(world.state()).force_n

    assert not force().any()
    round_until(peer, lambda _: force()[0] > 9.9, {"axes": [0.0, 1.0, 0.0, 0.0, 0.0]})
    before = world.state().bodies["cautery"].translation_mm
    for _ in range(50):
        round_until(peer, lambda _: True, {"axes": [0.0, 1.0, 0.0, 0.0, 0.0]})
        node.step(world, 0)
    assert (world.state().bodies["cautery"].translation_mm - before)[0] > 0.0
    round_until(peer, lambda _: not force().any(), {"axes": [0.0, math.nan, 0.0, 0.0, 0.0]})
    round_until(peer, lambda _: force()[0] > 9.9, {"axes": [0.0, 1.0, 0.0, 0.0, 0.0]})
    round_until(peer, lambda _: not force().any(), {"axes": [0.0, 1.0]})


def slow(device):
    """``device`` with a spring that is passive up to long periods: the tests' machine is busy."""
    return replace(device, haptic=replace(device.haptic, damping_n_s_m=500.0, period_s=0.001))


def take(peer, hand, state, handle_m):
    """Move the handle there until the hand has it, without a force."""

    def is_taken(_):
        return not hand.wrench(state).force_n.any() and not hand.problem

    round_until(peer, is_taken, {"handle_m": handle_m})


def test_haptic_device_pulls_the_tool_and_feels_it(ros, peer, description):
    entry = slow(description.hand.device)
    hand = DeviceHand(ros, entry, "cautery")
    state = World(description).state()
    assert not hand.wrench(state).force_n.any()
    assert hand.problem == "/touch/measured_cp: no pose"
    take(peer, hand, state, [0.1, 0.0, 0.0])
    seen = round_until(
        peer,
        lambda seen: (
            hand.wrench(state).force_n[1] > 0.9 and seen["count"] and seen["force"][1] < -0.4
        ),
        {"handle_m": [0.1, 0.02, 0.0]},
    )
    assert seen["frame"] == "touch_base"
    np.testing.assert_allclose(hand.wrench(state).force_n, [0.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(seen["force"], [0.0, -0.5, 0.0], atol=1e-9)
    hand.rest()
    round_until(peer, lambda seen: seen["force"] == [0.0, 0.0, 0.0], {})
    # Taken anew where it is.
    take(peer, hand, state, [0.1, 0.02, 0.0])


@pytest.mark.parametrize(
    ("command", "problem"),
    [
        ({"handle_m": [0.1, 0.05, 0.0], "late_s": 60}, "the pose is stale"),
        ({"handle_m": [math.nan, 0.0, 0.0]}, "a position is not finite"),
    ],
)
def test_handle_that_is_not_known_is_let_go(ros, peer, description, command, problem):
    hand = DeviceHand(ros, slow(description.hand.device), "cautery")
    state = World(description).state()
    take(peer, hand, state, [0.1, 0.0, 0.0])
    pulled = {"handle_m": [0.1, 0.02, 0.0]}
    round_until(peer, lambda _: hand.wrench(state).force_n[1] > 0.9, pulled)
    round_until(
        peer,
        lambda seen: (
            not hand.wrench(state).force_n.any()
            and problem in hand.problem
            and seen["force"] == [0.0, 0.0, 0.0]
            and seen["count"] > 1
        ),
        command,
    )
