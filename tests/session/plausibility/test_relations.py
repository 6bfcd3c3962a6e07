"""Configured relations: each fails where its values leave the limit, and names them."""

import math

import numpy as np
import pytest

from app.case import (
    ApproachEntry,
    BoxEntry,
    DistanceEntry,
    EnvelopeEntry,
    PlausibilityEntry,
    SphereEntry,
)
from app.geometry import NS_PER_MS, Stamp, Transform
from app.session.relations import Relations

TOOL_FROM_TIP = Transform("cautery", "cautery_tip", np.eye(3), [0.0, 0.0, 70.0])


def checked(entry, poses, at_ms=0):
    """Failed and unknown relations for poses by (target, source)."""
    relations = entry if isinstance(entry, Relations) else Relations(entry, TOOL_FROM_TIP)
    return relations.check(lambda *ends: poses.get(ends), Stamp(at_ms * NS_PER_MS))


def moved(target, source, position_mm, turn=(0.0, 0.0, 0.0)):
    pose = Transform.from_rotation_vector(
        turn, np.array(position_mm, dtype=float), target=target, source=source
    )
    return {(target, source): pose}


MIDDLE = Transform("reference", "needle", np.eye(3), [10.0, 0.0, 0.0])
CASES = {
    "envelope by place": (
        PlausibilityEntry(pairs=(EnvelopeEntry("reference", "needle", 8.0, 0.1, MIDDLE),)),
        moved("reference", "needle", (17.9, 0, 0)),
        moved("reference", "needle", (18.1, 0, 0)),
        "needle in reference is 8.1 mm and 0.0 degrees from the middle of its envelope; "
        "expected at most 8 mm and 5.73 degrees",
    ),
    "envelope by rotation": (
        PlausibilityEntry(pairs=(EnvelopeEntry("reference", "needle", 8.0, 0.1, MIDDLE),)),
        moved("reference", "needle", (10, 0, 0), (0.09, 0, 0)),
        moved("reference", "needle", (10, 0, 0), (0.11, 0, 0)),
        "needle in reference is 0.0 mm and 6.3 degrees from the middle of its envelope; "
        "expected at most 8 mm and 5.73 degrees",
    ),
    "distance": (
        PlausibilityEntry(pairs=(DistanceEntry("cautery", "grip", 50.0, 2.0),)),
        moved("cautery", "grip", (0, 30, 40)),
        moved("cautery", "grip", (0, 30, 43)),
        "grip from cautery is 52.4 mm apart; expected 50 mm within 2 mm",
    ),
    "sphere": (
        PlausibilityEntry(workspace=SphereEntry("reference", (0.0, 0.0, 0.0), 100.0)),
        moved("reference", "cautery", (0, 0, 29)),
        moved("reference", "cautery", (0, 0, 31)),
        "cautery_tip in reference is 101.0 mm from the middle of the workspace; "
        "expected at most 100 mm",
    ),
    "box": (
        PlausibilityEntry(workspace=BoxEntry("reference", (-9.0, -9.0, 0.0), (9.0, 9.0, 99.0))),
        moved("reference", "cautery", (8, 8, 0)),
        moved("reference", "cautery", (8, -9.5, 0)),
        "cautery_tip in reference is at y = -9.5 mm; expected -9 to 9 mm, the workspace",
    ),
    "approach": (
        PlausibilityEntry(
            approach=ApproachEntry("reference", (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), math.radians(30))
        ),
        moved("reference", "cautery", (0, 0, 0), (math.radians(29), 0, 0)),
        moved("reference", "cautery", (0, 0, 0), (math.radians(31), 0, 0)),
        "axis of cautery_tip in reference is 31.0 degrees from the approach; "
        "expected at most 30 degrees",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_relation_holds_within_its_limit_and_names_values_beyond_it(case):
    entry, inside, outside, text = CASES[case]
    assert checked(entry, inside) == ({}, {})
    failed, unknown = checked(entry, outside)
    assert list(failed.values()) == [text]
    assert unknown == {}


@pytest.mark.parametrize("case", CASES)
def test_relation_without_its_frames_is_unknown(case):
    entry, *_ = CASES[case]
    failed, unknown = checked(entry, {})
    assert failed == {}
    (text,) = unknown.values()
    assert text.endswith(" is not known")


def test_middle_of_an_envelope_is_learned_from_one_breath():
    """The needle swings by 4 mm; the middle is in the middle, and a slip of 6 mm is found."""
    relations = Relations(
        PlausibilityEntry(pairs=(EnvelopeEntry("reference", "needle", 5.0, 0.2),)), TOOL_FROM_TIP
    )

    def breath(at_ms, slip_mm=0.0):
        swing_mm = 2.0 * math.sin(2.0 * math.pi * at_ms / 5000.0)
        return moved("reference", "needle", (50.0 + swing_mm + slip_mm, 0, 0), (0.0, 0.5, 0.0))

    for at_ms in range(0, 20_000, 20):
        assert checked(relations, breath(at_ms), at_ms) == ({}, {})
    failed, _ = checked(relations, breath(20_000, 6.0), 20_000)
    (text,) = failed.values()
    assert text.startswith("needle in reference is 6.0 mm and 0.0 degrees from the middle")


def test_middle_is_learned_although_the_mean_rotation_is_nearest_to_a_reflection():
    relations = Relations(
        PlausibilityEntry(pairs=(EnvelopeEntry("reference", "needle", 5.0, 0.2),)), TOOL_FROM_TIP
    )
    half_turns = [(math.pi, 0.0, 0.0), (0.0, math.pi, 0.0), (0.0, 0.0, math.pi)]
    for step, at_ms in enumerate(range(0, 6_000, 20)):
        checked(relations, moved("reference", "needle", (50.0, 0, 0), half_turns[step % 3]), at_ms)
    failed, _ = checked(relations, moved("reference", "needle", (90.0, 0, 0)), 6_000)
    assert failed


def test_no_relation_is_false_and_some_are_true():
    assert not Relations(PlausibilityEntry(), TOOL_FROM_TIP)
    assert all(Relations(entry, TOOL_FROM_TIP) for entry, *_ in CASES.values())


@pytest.mark.parametrize("case", ["sphere", "approach"])
def test_another_tip_is_checked_and_ends_a_contradiction_after_half_a_second(case):
    entry, _, outside, text = CASES[case]
    relations = Relations(entry, TOOL_FROM_TIP)
    assert list(checked(relations, outside, 0)[0].values()) == [text]
    short = Transform.from_rotation_vector(
        (math.radians(-10), 0.0, 0.0),
        np.array([0.0, 0.0, 60.0]),
        target="cautery",
        source="cautery_tip",
    )
    relations.use_tip(short)
    assert list(checked(relations, outside, 499)[0].values()) == [text]
    assert checked(relations, outside, 500)[0] == {}


def test_contradiction_ends_once_the_relation_has_held_for_half_a_second():
    entry, inside, outside, text = CASES["distance"]
    relations = Relations(entry, TOOL_FROM_TIP)
    assert checked(relations, outside, 0)[0] == {"grip from cautery": text}
    further = moved("cautery", "grip", (0, 30, 90))
    assert checked(relations, further, 20)[0] == {"grip from cautery": text}, "the first text"
    assert checked(relations, inside, 519)[0] == {"grip from cautery": text}
    assert checked(relations, inside, 520)[0] == {}
    assert checked(relations, inside, 540)[0] == {}
    assert "94.9 mm" in checked(relations, further, 560)[0]["grip from cautery"]
