"""What the page says, for every step of a case and for every reason there is."""

from dataclasses import replace

import numpy as np
import pytest

from app.cli.touch_arm import TOUCH_URDF
from app.fixture import MarginState, Reason
from app.geometry import Freshness, Transform
from app.registration import (
    DriftBound,
    RegistrationResult,
    given_registration,
    register_points,
)
from app.robot import load_robot
from app.session import RobotSetup
from app.viewer.readout.readout import readout
from app.viewer.readout.words import REASON_WORDS, distance_digits, why
from app.viewer.steps.view_state import ViewState
from tests.viewer.viewed_case import BREACH_FRAME, LOST


def test_every_state_and_every_reason_has_words_of_its_own():
    assert set(REASON_WORDS) == set(Reason)
    assert len(set(REASON_WORDS.values())) == len(Reason)
    assert len({state.display.label for state in MarginState}) == len(MarginState)


def test_unknown_tells_every_fault_and_nothing_else():
    reasons = (Reason.MISSING, Reason.STALE, Reason.STOP_DISTANCE, Reason.LATCHED)
    told = why(MarginState.UNKNOWN, reasons)
    assert told == f"{REASON_WORDS[Reason.MISSING]}; {REASON_WORDS[Reason.STALE]}"


def test_a_frame_that_never_came_is_named_where_the_margin_is_not_known(parts):
    """However long the tool is missing: a name that is misspelt in live.yaml does not come."""
    lost, seen = parts.feed.shown[LOST[2]], parts.feed.shown[BREACH_FRAME]
    problem = "tool.frame is 'rood': not among what the tracker sends so far, needle, rod"
    said = [
        readout(replace(shown, step=replace(shown.step, frames_problem=problem)))["why"]
        for shown in (lost, seen)
    ]
    assert said == [f"{readout(lost)['why']} ({problem})", readout(seen)["why"]]


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
    assert (said["state"], said["label"], said["distance"]) == ("UNKNOWN", "UNKNOWN", "\N{EN DASH}")


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
    assert readout(parts.feed.shown[BREACH_FRAME])["tre"] == ""


def registered(shown: ViewState, registration: RegistrationResult, tre_mm: float) -> ViewState:
    """The same step of a session with a robot, whose registration adds ``tre_mm``."""
    robot = RobotSetup(
        load_robot(TOUCH_URDF),
        "robot_base",
        "stylus",
        registration,
        DriftBound(translation_mm=1.0, rotation_rad=0.1),
    )
    decision = shown.step.decision
    decision = replace(decision, margin=replace(decision.margin, tre_mm=tre_mm))
    return replace(
        shown,
        content=replace(shown.content, robot=robot),
        step=replace(shown.step, decision=decision),
    )


def test_a_registration_that_was_given_adds_nothing(parts):
    given = given_registration(Transform("reference", "robot_base", np.eye(3), np.zeros(3)))
    said = readout(registered(parts.feed.shown[BREACH_FRAME], given, 0.0))
    assert said["registration"]["numbers"] == "uncertainty not known"
    assert said["tre"] == "adds nothing to the margins"


def test_a_registration_that_was_found_says_what_it_adds(parts):
    points = np.array([[0.0, 0, 0], [50, 0, 0], [0, 50, 0], [0, 0, 50]])
    off = points + np.array([[0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.1], [-0.1, 0, 0]])
    found = register_points(points, off, fixed_frame="reference", moving_frame="robot_base")
    shown = parts.feed.shown[BREACH_FRAME]
    said = readout(registered(shown, found, 0.344))
    assert said["registration"]["numbers"].startswith("4 points, FRE 0.")
    assert said["tre"] == "k\N{MIDDLE DOT}TRE at the tip 0.34 mm"
    # It may be small; an uncertainty that is not known is never said to be that.
    assert readout(registered(shown, found, 0.0))["tre"].endswith(" 0.00 mm")
