"""The force of the mouse on the tool: limits, and everything that ends it."""

from dataclasses import replace

import numpy as np
import pytest

from app.fixture import MarginState
from app.viewer.pointer_parts import (
    MAX_FORCE_N,
    MAX_RISE_N_S,
    MAX_SILENCE_NS,
    STIFFNESS_N_MM,
    MouseHand,
)
from tests.manual_clock import ManualClock

STEP_NS = 10_000_000
FAR = np.array([50.0, 0.0, 0.0])


@pytest.fixture
def clock():
    return ManualClock()


@pytest.fixture
def hand(clock):
    return MouseHand(clock)


@pytest.fixture
def shown(parts):
    return parts.feed.shown[0]


def tip(shown):
    return shown.step.tumor_from_tip.translation_mm


def after(hand, clock, shown, seconds, page="page1"):
    force = hand.force_n(shown)
    for _ in range(round(seconds * 1e9 / STEP_NS)):
        clock.ns += STEP_NS
        hand.heard(page)
        force = hand.force_n(shown)
    return force


def test_force_is_a_spring_along_the_axes_of_the_tool(hand, clock, shown):
    away = np.array([3.0, -4.0, 2.0])
    assert hand.hold("page1", tip(shown) + away)
    force = after(hand, clock, shown, 1.0)
    expected = shown.step.tumor_from_tip.rotation.T @ (STIFFNESS_N_MM * away)
    np.testing.assert_allclose(force, expected, atol=1e-9)


def test_force_and_its_rise_are_limited(hand, clock, shown):
    hand.hold("page1", tip(shown) + 20.0 * FAR)
    assert np.linalg.norm(hand.force_n(shown)) == 0.0
    before = 0.0
    for _ in range(30):
        clock.ns += STEP_NS
        size = float(np.linalg.norm(hand.force_n(shown)))
        assert size <= before + MAX_RISE_N_S * 0.01 + 1e-9
        before = size
    assert before == pytest.approx(MAX_FORCE_N)


def test_force_ends_with_release_and_begins_at_zero(hand, clock, shown):
    hand.hold("page1", tip(shown) + FAR)
    assert np.linalg.norm(after(hand, clock, shown, 0.5)) > 1.0
    hand.release("page1")
    assert hand.holder() is None and hand.target_mm() is None
    assert not hand.force_n(shown).any()
    clock.ns += 10**9
    hand.hold("page1", tip(shown) + FAR)
    assert not hand.force_n(shown).any()


def test_silent_page_has_let_go_for_good(hand, clock, shown):
    hand.hold("page1", tip(shown) + FAR)
    assert after(hand, clock, shown, 0.5).any()
    clock.ns += MAX_SILENCE_NS + 1
    assert not hand.force_n(shown).any()
    hand.heard("page1")
    assert hand.holder() is None
    assert not after(hand, clock, shown, 0.2).any()


def test_only_the_page_that_holds_the_tool_moves_or_releases_it(hand, clock, shown):
    hand.hold("page1", tip(shown) + FAR)
    assert not hand.hold("page2", tip(shown))
    hand.release("page2")
    assert hand.holder() == "page1"
    clock.ns += MAX_SILENCE_NS + 1
    hand.heard("page2")
    assert hand.hold("page2", tip(shown))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_point_that_is_not_finite_is_refused(hand, shown, bad):
    assert not hand.hold("page1", np.array([bad, 0.0, 0.0]))
    assert hand.holder() is None


def test_no_force_without_a_known_tool(hand, clock, shown):
    hand.hold("page1", tip(shown) + FAR)
    assert after(hand, clock, shown, 0.5).any()
    assert not hand.force_n(shown.as_unknown("the session has ended")).any()
    assert not hand.force_n(None).any()
    lost = replace(shown, step=replace(shown.step, tumor_from_tip=None))
    assert shown.step.decision.state is not MarginState.UNKNOWN
    assert not hand.force_n(lost).any()
