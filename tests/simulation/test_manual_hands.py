"""Hands that a person moves: their force, and that it ends without input."""

import numpy as np
import pytest

from app.geometry import NS_PER_MS
from app.simulation import KEYS, JoyEntry, JoyHand, KeyHand, WorldState
from app.simulation.hand import JOY_LIFETIME_NS, KEY_LIFETIME_NS
from tests.manual_clock import ManualClock

STATE = WorldState(0, {}, {})


@pytest.fixture
def clock():
    return ManualClock()


@pytest.fixture
def joy(clock):
    entry = JoyEntry("/joy", (1, 0, 3), (1.0, -1.0, 1.0), 0.1)
    return JoyHand(entry, "cautery", 10.0, clock)


def force(hand):
    wrench = hand.wrench(STATE)
    assert np.array_equal(wrench.torque_n_m, np.zeros(3))
    return wrench.force_n.tolist()


def test_axes_push_along_the_world_with_a_dead_zone(joy):
    assert force(joy) == [0.0, 0.0, 0.0]
    assert joy.take([0.0, 1.0, 0.9, 0.0]) == ""
    assert force(joy) == pytest.approx([10.0, 0.0, 0.0])
    assert joy.take([0.55, 0.0, 0.9, 0.0]) == ""
    assert force(joy) == pytest.approx([0.0, -5.0, 0.0])
    assert joy.take([0.06, 0.06, 0.0, 0.0]) == ""
    assert force(joy) == [0.0, 0.0, 0.0]
    assert joy.take([5.0, -5.0, 0.0, 5.0]) == ""
    assert np.linalg.norm(force(joy)) == pytest.approx(10.0), "no more than the hand's force"


def test_force_ends_when_no_message_comes(joy, clock):
    joy.take([0.0, 1.0, 0.0, 0.0])
    clock.ns = JOY_LIFETIME_NS
    assert force(joy)[0] == pytest.approx(10.0)
    clock.ns += 1
    assert force(joy) == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("axes", "problem"),
    [
        ([0.0, 1.0], "2 axes; expected at least 4"),
        ([], "0 axes; expected at least 4"),
        ([0.0, np.nan, 0.0, 0.0], "axes are [nan, -0.0, 0.0]; expected finite numbers"),
        ([0.0, np.inf, 0.0, 0.0], "axes are [inf, -0.0, 0.0]; expected finite numbers"),
    ],
)
def test_axes_that_cannot_be_used_end_the_force(joy, axes, problem):
    joy.take([0.0, 1.0, 0.0, 0.0])
    assert joy.take(axes) == problem
    assert force(joy) == [0.0, 0.0, 0.0]


def test_keys_push_until_they_end_or_another_is_pressed(clock):
    hand = KeyHand("cautery", 10.0, clock)
    for key, direction in KEYS.items():
        hand.press(key)
        assert force(hand) == [10.0 * each for each in direction]
    hand.press("W")
    clock.ns += KEY_LIFETIME_NS
    assert force(hand) == [0.0, 10.0, 0.0]
    clock.ns += NS_PER_MS
    assert force(hand) == [0.0, 0.0, 0.0]
    hand.press("w")
    hand.press(" ")
    assert force(hand) == [0.0, 0.0, 0.0]
