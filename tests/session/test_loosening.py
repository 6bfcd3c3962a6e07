"""Changes that loosen a session, their descriptions, and the setup before a re-arm."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.fixture import MarginParameters
from app.hold import loosened_margins, tightest_margins
from app.hold.changes import LOOSER_ABOVE, LOOSER_BELOW
from app.session import SessionSetup
from app.session.loosening import AcknowledgedSetup, loosenings
from tests.doubles import PARAMETERS, AnalyticSphere
from tests.session_content import one_link_content

CONTENT = one_link_content()
TOOL, TUMOR, _ = CONTENT.static_edges
SETUP = SessionSetup(TOOL, TUMOR, AnalyticSphere(10.0), PARAMETERS, CONTENT.robot)


def with_margins(**changes):
    return replace(SETUP, margins=PARAMETERS.replaced(**changes))


def test_every_margin_has_a_looser_direction():
    assert sorted((*LOOSER_BELOW, *LOOSER_ABOVE)) == sorted(MarginParameters.ranges())


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("stop_mm", 0.5, "stop_mm lowered from 1 to 0.5"),
        ("warn_mm", 4.0, "warn_mm lowered from 5 to 4"),
        ("k_tre", 0.0, "k_tre lowered from 2 to 0"),
        ("v_max_mm_s", 1.0, "v_max_mm_s lowered from 50 to 1"),
        ("release_samples", 1, "release_samples lowered from 3 to 1"),
        ("release_band_mm", 0.0, "release_band_mm lowered from 0.5 to 0"),
        ("stale_after_ns", 10_000_000_000, "stale_after_ms raised from 60 to 10000"),
        ("frozen_after_ns", 60_000_000_000, "frozen_after_ms raised from 1000 to 60000"),
    ],
)
def test_looser_margins_are_named_with_old_and_new_value(name, value, text):
    before = MarginParameters(1.0, 5.0, 2.0, 50.0, 60_000_000, 3, 0.5, 1_000_000_000)
    after = before.replaced(**{name: value})
    assert loosened_margins(before, after, follows_tumor=False) == [text]
    assert loosened_margins(after, before, follows_tumor=False) == []


def test_higher_speed_is_looser_only_where_the_tumour_is_followed():
    faster = PARAMETERS.replaced(v_max_mm_s=PARAMETERS.v_max_mm_s + 1.0)
    assert loosened_margins(PARAMETERS, faster, follows_tumor=False) == []
    assert loosened_margins(PARAMETERS, faster, follows_tumor=True) != []


MARGINS = st.builds(
    MarginParameters,
    stop_mm=st.floats(0.0, 4.0),
    warn_mm=st.floats(4.5, 200.0),
    k_tre=st.floats(0.0, 10.0),
    v_max_mm_s=st.floats(0.0, 1000.0),
    stale_after_ns=st.integers(1, 10**10),
    release_samples=st.integers(1, 1000),
    release_band_mm=st.floats(0.0, 10.0),
    frozen_after_ns=st.integers(1, 6 * 10**10),
)


@given(MARGINS, MARGINS, st.booleans())
def test_what_applies_before_a_rearm_loosens_nothing_and_keeps_what_tightens(
    in_use, requested, follows
):
    applied = tightest_margins(in_use, requested, follows_tumor=follows)
    assert loosened_margins(in_use, applied, follows_tumor=follows) == []
    for name in MarginParameters.ranges():
        assert getattr(applied, name) in (getattr(in_use, name), getattr(requested, name))
    if not loosened_margins(in_use, requested, follows_tumor=follows):
        assert applied == requested


def test_each_change_of_tumour_tool_and_robot_loosens():
    ball = replace(SETUP, proximity=AnalyticSphere(9.0))
    moved = replace(SETUP, frame_from_tumor=TUMOR.inverse().inverse())
    robot = replace(SETUP, robot=replace(CONTENT.robot, registration=None))
    assert loosenings(SETUP, ball) == loosenings(SETUP, moved) == ["tumour replaced"]
    assert loosenings(SETUP, ball, "tumour replaced: 3 times smaller") == [
        "tumour replaced: 3 times smaller"
    ]
    assert loosenings(SETUP, robot) == ["registration removed"]
    assert loosenings(SETUP, replace(SETUP, tool_from_tip=TOOL.inverse().inverse())) == [
        "calibration of the tool replaced: the tip is moved by 0.00 mm and its axis turned by "
        "0.00 degrees"
    ]
    stated = replace(SETUP, tumor_sigma_mm=0.6)
    assert loosenings(SETUP, stated) == []
    assert loosenings(stated, SETUP) == ["uncertainty of the tumour lowered from 0.60 to 0.00 mm"]
    stated = replace(SETUP, tip_sigma_mm=0.4)
    assert loosenings(SETUP, stated) == []
    assert loosenings(stated, SETUP) == ["uncertainty of the tip lowered from 0.40 to 0.00 mm"]
    assert loosenings(SETUP, SETUP) == []


def test_changes_are_those_since_the_last_rearm_whatever_was_set_in_between():
    acknowledged = AcknowledgedSetup(SETUP)
    assert acknowledged.change(SETUP, with_margins(stop_mm=0.5), "")
    assert acknowledged.changes == (f"stop_mm lowered from {PARAMETERS.stop_mm:g} to 0.5",)
    assert acknowledged.change(SETUP, with_margins(stop_mm=0.25), "")
    assert acknowledged.changes == (f"stop_mm lowered from {PARAMETERS.stop_mm:g} to 0.25",)
    assert not acknowledged.change(SETUP, SETUP, "")
    assert acknowledged.changes == ("a change that loosened the session was undone",)
    acknowledged.acknowledge(SETUP)
    assert acknowledged.changes == ()


def test_tightening_is_the_base_of_the_next_loosening():
    acknowledged, tight = AcknowledgedSetup(SETUP), with_margins(stop_mm=4.0)
    assert not acknowledged.change(SETUP, tight, "")
    assert acknowledged.changes == ()
    assert acknowledged.change(tight, SETUP, "")
    assert acknowledged.changes == (f"stop_mm lowered from 4 to {PARAMETERS.stop_mm:g}",)
