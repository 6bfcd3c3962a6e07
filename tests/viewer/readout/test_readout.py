"""Values of the page for every step of a case and every reason."""

from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from app.case import Activation
from app.fixture import MarginState, Reason
from app.geometry import Freshness, Transform
from app.registration import DriftBound, given_registration, register_points
from app.robot import load_robot
from app.session import RobotSetup, Role, StructureStep, ToolDistance, moment_text
from app.synthetic.motion import TOUCH_URDF
from app.viewer.page_values import distance_text, readout, reason_text
from tests.viewer.viewed_case import BREACH_FRAME, LOST

DASH = distance_text(None)


def test_every_state_and_reason_has_a_text_of_its_own():
    assert len({reason.text for reason in Reason}) == len(Reason)
    assert len({state.display.label for state in MarginState}) == len(MarginState)


def test_unknown_lists_every_fault_and_nothing_else():
    reasons = (Reason.MISSING, Reason.STALE, Reason.STOP_DISTANCE, Reason.LATCHED)
    text = reason_text(MarginState.UNKNOWN, reasons)
    assert text == f"{Reason.MISSING.text}; {Reason.STALE.text}"


def test_never_received_frame_is_named_while_unknown(parts):
    """A frame whose name is misspelt in live.yaml is never received."""
    lost, known = parts.feed.shown[LOST[2]], parts.feed.shown[BREACH_FRAME]
    problem = "tool.frame is 'rood': not among what the tracker sends so far, needle, rod"
    values = [
        readout(replace(shown, step=replace(shown.step, frames_problems=(problem,))))["why"]
        for shown in (lost, known)
    ]
    assert values == [f"{readout(lost)['why']} ({problem})", readout(known)["why"]]


def test_unknown_says_what_to_do_and_a_known_state_does_not(parts):
    lost, known = parts.feed.shown[LOST[2]], parts.feed.shown[BREACH_FRAME]
    assert readout(lost)["todo"].startswith("Bring tool and sensors into the tracker's view")
    assert readout(known)["todo"] == ""
    assert "terminal" in readout(known.as_unknown("the session has ended"))["todo"]


def test_structures_have_titles_and_a_far_one_a_lower_bound(parts):
    shown = parts.feed.shown[BREACH_FRAME]
    step = shown.step
    path = step.between_frames
    tumor = StructureStep("tumor", Role.TARGET, step.decision, step.tumor_from_tip, path)
    wall = tumor._replace(name="chest_wall", role=Role.FORBIDDEN)
    values = readout(replace(shown, step=replace(step, structures=(tumor, wall))))
    assert [each["title"] for each in values["structures"]] == ["tumour", "chest wall"]
    far = wall._replace(at_least_mm=52.9)
    values = readout(replace(shown, step=replace(step, structures=(tumor, far))))
    assert values["structures"][1]["distance"] == "\N{GREATER-THAN OR EQUAL TO} 52"


def test_known_state_has_its_worst_reason():
    text = reason_text(MarginState.POSITIVE, (Reason.INSIDE, Reason.STOP_DISTANCE, Reason.LATCHED))
    assert text == Reason.INSIDE.text


@pytest.mark.parametrize(
    ("mm", "digits"),
    [(12.34, "12.3"), (-0.96, "\N{MINUS SIGN}1.0"), (0.0, "0.0"), (None, "\N{EN DASH}")],
)
def test_distance_has_one_decimal_and_a_minus_sign(mm, digits):
    assert distance_text(mm) == digits


def test_state_is_unknown_before_the_first_step():
    values = readout(None)
    assert (values["state"], values["label"], values["distance"]) == (
        "UNKNOWN",
        "UNKNOWN",
        "\N{EN DASH}",
    )


def test_each_step_has_a_distance_only_while_it_is_known(parts):
    states = set()
    for shown in parts.feed.shown:
        values = readout(shown)
        states.add(values["state"])
        assert values["state"] == shown.step.decision.state.name
        assert values["why"]
        assert (values["distance"] == "\N{EN DASH}") == (values["state"] == "UNKNOWN")
    assert states == {"NEGATIVE", "WARNING", "POSITIVE", "UNKNOWN"}


def test_silent_session_has_no_valid_lamp(parts):
    silent = parts.feed.shown[0].as_unknown("nothing comes")
    values = readout(silent)
    assert (values["state"], values["why"], values["trend"]) == ("UNKNOWN", "nothing comes", "")
    assert {lamp["light"] for lamp in values["lamps"]} == {"stale"}
    assert {lamp["age"] for lamp in values["lamps"]} == {""}


def test_lamp_of_a_lost_tool_has_the_age_of_its_last_sample(parts):
    lamps = {lamp.name: lamp for lamp in parts.feed.shown[LOST[2]].lamps}
    assert lamps["RodToTracker"].freshness is Freshness.MISSING
    assert lamps["RodToTracker"].age_ns == 3 * 50_000_000
    assert lamps["NeedleToTracker"].freshness is Freshness.VALID


def test_registration_without_a_robot(parts):
    values = readout(parts.feed.shown[BREACH_FRAME])["registration"]
    assert values == {"ok": True, "verdict": "no robot", "numbers": ""}
    assert readout(parts.feed.shown[BREACH_FRAME])["tre"] == ""


def registered(shown, registration, tre_mm):
    """The same step with a robot whose registration adds ``tre_mm``."""
    robot = RobotSetup(
        load_robot(TOUCH_URDF),
        "robot_base",
        "stylus",
        registration,
        DriftBound(translation_mm=1.0, rotation_rad=0.1),
    )
    decision = shown.step.decision
    decision = decision._replace(margin=decision.margin._replace(tre_mm=tre_mm))
    return replace(
        shown,
        content=replace(shown.content, robot=robot),
        step=replace(shown.step, decision=decision),
    )


def test_given_registration_adds_nothing_to_the_margins(parts):
    given = given_registration(Transform("reference", "robot_base", np.eye(3), np.zeros(3)))
    values = readout(registered(parts.feed.shown[BREACH_FRAME], given, 0.0))
    assert values["registration"]["numbers"] == "uncertainty not known"
    assert values["tre"] == "adds nothing to the margins"


def test_computed_registration_states_what_it_adds(parts):
    points = np.array([[0.0, 0, 0], [50, 0, 0], [0, 50, 0], [0, 0, 50]])
    off = points + np.array([[0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.1], [-0.1, 0, 0]])
    found = register_points(points, off, fixed_frame="reference", moving_frame="robot_base")
    shown = parts.feed.shown[BREACH_FRAME]
    values = readout(registered(shown, found, 0.344))
    assert values["registration"]["numbers"].startswith("4 points, FRE 0.")
    assert values["tre"] == "k\N{MIDDLE DOT}TRE at the tip 0.34 mm"
    # A known uncertainty may be small; an unknown one has no number.
    assert readout(registered(shown, found, 0.0))["tre"].endswith(" 0.00 mm")


def held(shown, state, causes):
    """The same step on a latched hold with these causes, oldest first."""
    reasons = (*shown.step.decision.reasons, Reason.LATCHED)
    decision = shown.step.decision._replace(state=state, reasons=reasons, hold=True)
    return replace(shown, step=replace(shown.step, decision=decision, hold_causes=causes))


def test_hold_is_the_label_and_the_margin_is_beside_it(parts):
    values = readout(held(parts.feed.shown[0], MarginState.NEGATIVE, ("first", "newest")))
    assert (values["state"], values["label"], values["why"]) == ("NEGATIVE", "HOLD", "newest")
    assert values["beside"] == {"shown": "NEGATIVE", "symbol": "\N{CHECK MARK}", "label": "CLEAR"}
    inside = readout(held(parts.feed.shown[BREACH_FRAME], MarginState.POSITIVE, ("first",)))
    assert (inside["label"], inside["beside"]["label"]) == ("IN TUMOUR", "HOLD")
    assert readout(parts.feed.shown[0])["beside"] is None


def test_causes_are_short_and_the_newest_is_first(parts):
    long = "tumour replaced: " + "it does not overlap the former one, " * 5
    causes = readout(held(parts.feed.shown[0], MarginState.NEGATIVE, ("first", long)))["causes"]
    assert [cause["full"] for cause in causes] == [long, "first"]
    assert causes[0]["short"].startswith("tumour replaced: it does not")
    assert len(causes[0]["short"]) <= 62 and causes[0]["short"].endswith(" \N{HORIZONTAL ELLIPSIS}")


def test_terms_of_the_applied_margins_add_up(parts):
    values = readout(parts.feed.shown[BREACH_FRAME])
    *terms, applied = values["terms"]
    assert terms[0] == {"name": "as set", "stop": "1.00", "warn": "5.00"}
    for kind in ("stop", "warn"):
        total = sum(float(term[kind]) for term in terms)
        assert float(applied[kind]) == pytest.approx(total, abs=0.011)
        assert float(values[kind]) == pytest.approx(total, abs=0.06)
    assert readout(parts.feed.shown[LOST[2]])["terms"] == []


def test_moment_has_the_time_of_day_if_the_clock_counts_from_1970():
    assert moment_text(100_250_000_000, 0.25) == "0.2 s"
    stamp_ns = 1_795_497_414_040_000_000
    at = datetime.fromtimestamp(1_795_497_414)
    assert moment_text(stamp_ns, 23.44) == f"{at:%H:%M:%S}, 23.4 s"


def test_cautery_of_a_silent_session_is_unknown(parts):
    shown = parts.feed.shown[0]
    assert readout(shown)["activation"] is None
    for state in Activation:
        frame = replace(shown.step.frame, activation=state)
        told = replace(shown, step=replace(shown.step, frame=frame))
        values = readout(told)
        assert values["activation"]["state"] == state.value
        assert {**values, "activation": None} == readout(shown)
        assert readout(told.as_unknown("nothing comes"))["activation"]["state"] == "unknown"


def test_structure_that_is_off_is_listed_with_its_reason(parts):
    known = parts.feed.shown[BREACH_FRAME]
    step = replace(known.step, off={"chest_wall": "not in the field"})
    assert readout(replace(known, step=step))["structures"] == [
        {"name": "chest_wall", "title": "chest wall", "shown": "OFF", "off": "not in the field"}
    ]


def test_other_tools_are_listed_with_their_warnings(parts):
    shown = parts.feed.shown[BREACH_FRAME]
    step = shown.step
    tools = (
        ToolDistance("left", MarginState.WARNING, (), step.decision.proximity),
        ToolDistance("clip_arm", MarginState.NEGATIVE, (), at_least_mm=52.9),
        ToolDistance("probe", MarginState.UNKNOWN, (Reason.STALE,)),
    )
    near = replace(shown, step=replace(step, tools=tools))
    values = readout(near)
    depth = distance_text(shown.distance_mm)
    assert [tuple(each.values()) for each in values.pop("tools")] == [
        ("left", tools[0].text, "WARNING", "!", "CLOSE", depth),
        ("clip arm", "", "NEGATIVE", "✓", "CLEAR", "≥ 52"),
        ("probe", "distance of tool 'probe' is not known (stale)", "UNKNOWN", "?", "UNKNOWN", DASH),
    ]
    assert values == {key: value for key, value in readout(shown).items() if key != "tools"}
    silent = readout(near.as_unknown("nothing comes"))["tools"]
    assert {(each["shown"], each["warning"], each["distance"]) for each in silent} == {
        ("UNKNOWN", "", DASH)
    }
