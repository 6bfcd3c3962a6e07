"""What the page says, for every step of a case and for every reason there is."""

import pytest

from app.fixture import MarginState, Reason
from app.scene.watchdog import Freshness
from app.viewer.readout import readout
from app.viewer.words import REASON_WORDS, STATE_WORDS, distance_digits, why
from tests.viewer.viewed_case import BREACH_FRAME, LOST


def test_every_state_and_every_reason_has_words_of_its_own():
    assert set(STATE_WORDS) == set(MarginState)
    assert set(REASON_WORDS) == set(Reason)
    assert len(set(REASON_WORDS.values())) == len(Reason)
    assert len(set(STATE_WORDS.values())) == len(MarginState)


def test_unknown_tells_every_fault_and_nothing_else():
    reasons = (Reason.MISSING, Reason.STALE, Reason.STOP_DISTANCE, Reason.LATCHED)
    told = why(MarginState.UNKNOWN, reasons)
    assert told == f"{REASON_WORDS[Reason.MISSING]}; {REASON_WORDS[Reason.STALE]}"


def test_a_known_state_tells_its_worst_reason():
    told = why(MarginState.POSITIVE, (Reason.INSIDE, Reason.STOP_DISTANCE, Reason.LATCHED))
    assert told == REASON_WORDS[Reason.INSIDE]


@pytest.mark.parametrize(
    ("mm", "digits"),
    [(12.34, "12.3"), (-0.96, "\N{MINUS SIGN}1.0"), (0.0, "0.0"), (None, "\N{EN DASH}")],
)
def test_digits(mm, digits):
    assert distance_digits(mm) == digits


def test_nothing_at_all_is_unknown():
    said = readout(None)
    assert (said["state"], said["word"], said["distance"]) == ("UNKNOWN", "UNKNOWN", "\N{EN DASH}")


def test_each_step_says_its_state_and_a_distance_only_where_it_is_known(parts):
    states = set()
    for shown in parts.feed.shown:
        said = readout(shown)
        states.add(said["state"])
        assert said["state"] == shown.step.decision.state.name
        assert said["why"]
        assert (said["distance"] == "\N{EN DASH}") == (said["state"] == "UNKNOWN")
    assert states == {"NEGATIVE", "WARNING", "POSITIVE", "UNKNOWN"}


def test_a_step_that_is_not_of_the_present_has_no_lamp_that_is_lit(parts):
    silent = parts.feed.shown[0].as_unknown("nothing comes")
    said = readout(silent)
    assert (said["state"], said["why"], said["trend"]) == ("UNKNOWN", "nothing comes", "")
    assert {lamp["light"] for lamp in said["lamps"]} == {"stale"}
    assert {lamp["age"] for lamp in said["lamps"]} == {""}


def test_the_lamp_of_a_lost_tool_is_out_with_the_age_of_its_last_sample(parts):
    lamps = {lamp.name: lamp for lamp in parts.feed.shown[LOST[2]].lamps}
    assert lamps["RodToTracker"].freshness is Freshness.MISSING
    assert lamps["RodToTracker"].age_ns == 3 * 50_000_000
    assert lamps["NeedleToTracker"].freshness is Freshness.VALID


def test_the_registration_is_told_where_there_is_a_robot(parts):
    said = readout(parts.feed.shown[BREACH_FRAME])["registration"]
    assert said == {"ok": True, "word": "no robot", "numbers": ""}
