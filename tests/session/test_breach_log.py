"""Breaches of a session: counted as in the report, with place and part, and displayed."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import trimesh

from app.analysis import find_breaches
from app.case import Activation, TrackingFrame
from app.fixture import FixtureDecision, MarginState, Proximity, Reason, Witnesses
from app.geometry import NS_PER_MS, InputError, Stamp, SurfaceMesh, Transform, anatomical_words
from app.report import ReportRow
from app.session import (
    HOLD,
    SHOWN_STATES,
    STOP,
    BreachLog,
    Role,
    StepResult,
    banner_states,
    checked_axes,
    is_tip,
    margin_display,
    place_letters,
)
from app.session.breach_log import MAX_LISTED
from app.session.shown_state import structure_title
from app.session.structure import StructureStep
from tests.fixture.control.test_state_display import VISIONS, Rgb, seen_ratio

STALE_NS = 200 * NS_PER_MS
STEP_NS = 50 * NS_PER_MS
CENTER_MM = np.array([100.0, -40.0, 7.0])


@pytest.fixture
def tumor() -> SurfaceMesh:
    """A box of 20 mm around `CENTER_MM`, one of whose sides has most of its vertices."""
    box = trimesh.creation.box((20.0, 20.0, 20.0))
    fine = box.subdivide(np.flatnonzero(box.face_normals[:, 0] > 0.5))
    return SurfaceMesh("needle_tumor", fine.vertices + CENTER_MM, fine.faces)


def step_of(
    index, distance_mm, *, ns=None, side=(0.0, 0.0, 10.0), behind_tip_mm=0.0, activation=None
):
    """A step whose deepest tool point lies ``behind_tip_mm`` from the tip, at ``side``."""
    on_tumor = CENTER_MM + np.array(side)
    on_tool = on_tumor + np.array([0.0, 0.0, distance_mm or 0.0])
    proximity = None
    if distance_mm is not None:
        witnesses = Witnesses.single(distance_mm, on_tool, on_tumor, np.array([0.0, 0.0, 1.0]))
        proximity = Proximity(distance_mm, witnesses, None)
    stamp = Stamp(index * STEP_NS if ns is None else ns, "tracker")
    inside = distance_mm is not None and distance_mm < 0.0
    state = MarginState.POSITIVE if inside else MarginState.NEGATIVE
    decision = FixtureDecision(state, (), proximity, None, None, False, stamp, index)
    matrix = np.eye(4)
    matrix[:3, 3] = on_tool - np.array([behind_tip_mm, 0.0, 0.0])
    return StepResult(
        index=index,
        frame=TrackingFrame(stamp, (), (), activation=activation),
        decision=decision,
        tumor_from_tip=Transform.from_matrix(matrix, target="needle_tumor", source="tip"),
        virtual_fixture=None,
        links={},
        joints=None,
    )


@pytest.mark.parametrize("seed", range(20))
def test_breaches_are_those_of_the_report(seed, tumor):
    random = np.random.default_rng(seed)
    log, rows, now_ns = BreachLog(tumor, STALE_NS, {}), [], 10**9
    steps = []
    for index in range(120):
        now_ns += int(random.choice([STEP_NS, STEP_NS, STEP_NS, 3 * STALE_NS, -STEP_NS]))
        distance = None if random.random() < 0.1 else float(random.normal(0.5, 1.0))
        steps.append(step_of(index, distance, ns=now_ns))
        rows.append(ReportRow.from_step(steps[-1]))
        found = log.observe(steps[-1])
        expected = find_breaches(rows, STALE_NS)
        assert found.count == len(expected)
        assert [(e.first, e.last, e.deepest, -e.depth_mm, e.begin_s) for e in found.entries] == [
            (b.first, b.last, b.deepest, b.min_signed_distance_mm, b.start_s) for b in expected
        ]


def test_breaches_of_each_structure_are_those_of_a_log_of_its_own(tumor):
    """Also of one that is switched off, and of one that is far: neither has a distance."""
    random, names = np.random.default_rng(3), ("tumor", "chest_wall", "vessel")
    log = BreachLog(tumor, STALE_NS, dict.fromkeys(names[1:], tumor))
    own = {name: BreachLog(tumor, STALE_NS, {}) for name in names}
    for index in range(300):
        is_on = {name: name == "tumor" or random.random() > 0.05 for name in names}
        steps = {name: step_of(index, float(random.normal(0.5, 1.0))) for name in names}
        structures = []
        for name, step in steps.items():
            if not is_on[name]:  # its breach ends
                own[name].observe(step_of(index, 1.0))
                continue
            own[name].observe(step)
            pose = step.tumor_from_tip
            structures.append(StructureStep(name, Role.TARGET, step.decision, pose, None))
        found = log.observe(replace(steps["tumor"], structures=tuple(structures)))
    assert found.count == sum(each.breaches.count for each in own.values()) > 150
    assert found.is_inside == any(each.breaches.is_inside for each in own.values())
    for name in names:
        listed = [replace(e, number=0, structure="") for e in found.entries if e.structure == name]
        alone = [replace(each, number=0) for each in own[name].breaches.entries]
        assert listed[1:] == alone[len(alone) - len(listed) + 1 :]
    assert [e.number for e in found.entries[-9:]] == list(range(found.count - 8, found.count + 1))
    assert found.text.endswith(f"mm ({structure_title(found.deepest.structure)})")
    assert found.entries[-1].place_text.startswith(structure_title(found.entries[-1].structure))


def test_breach_has_place_part_and_time(tumor):
    log = BreachLog(tumor, STALE_NS, {})
    log.observe(step_of(0, 4.0))
    log.observe(step_of(1, -1.0))
    log.observe(step_of(2, -3.25, side=(9.0, 0.0, -10.0), behind_tip_mm=12.4))
    inside = log.observe(step_of(3, -0.5))
    assert inside.is_inside
    after = log.observe(step_of(4, 2.0))
    (entry,) = after.entries
    assert not after.is_inside and not entry.is_open and inside.entries[0].is_open
    assert (entry.first, entry.deepest, entry.last) == (1, 2, 3)
    assert (entry.begin_s, entry.duration_s, entry.depth_mm) == (0.05, 0.1, 3.25)
    assert (entry.place, entry.place_text) == ("IR", "inferior right")
    assert (entry.from_tip_mm, entry.part_text) == (pytest.approx(12.4), "12 mm from the tip")
    assert after.text == "1 breach so far, deepest 3.2 mm"
    by_tip = BreachLog(tumor, STALE_NS, {}).observe(step_of(0, -1.0, behind_tip_mm=1.5)).entries[0]
    assert by_tip.part_text == "tip"
    assert replace(by_tip, from_tip_mm=None).part_text == "part of the tool not known"


def test_long_list_keeps_count_first_and_deepest(tumor):
    log = BreachLog(tumor, STALE_NS, {})
    for index in range(2 * (MAX_LISTED + 100)):
        depth = -9.0 if index == 20 else -1.0
        found = log.observe(step_of(index, depth if index % 2 == 0 else 3.0))
    assert (found.count, len(found.entries)) == (MAX_LISTED + 100, MAX_LISTED)
    numbers = [entry.number for entry in found.entries]
    assert numbers[0] == 1 and numbers[1] == 11 and numbers[-1] == MAX_LISTED + 100
    assert found.deepest is not None and found.deepest.depth_mm == 9.0
    assert found.text == f"{MAX_LISTED + 100} breaches so far, deepest 9.0 mm"


def test_tool_inside_the_stop_margin_has_a_display_of_its_own():
    decision = step_of(0, 0.4).decision
    displays = [
        margin_display(decision._replace(state=state, reasons=reasons))
        for state, reasons in (
            (MarginState.WARNING, (Reason.WARNING_DISTANCE,)),
            (MarginState.WARNING, (Reason.STOP_DISTANCE,)),
            (MarginState.POSITIVE, (Reason.INSIDE, Reason.STOP_DISTANCE)),
            (MarginState.UNKNOWN, (Reason.STALE, Reason.STOP_DISTANCE)),
        )
    ]
    assert [each.key for each in displays] == ["WARNING", STOP, "POSITIVE", "UNKNOWN"]
    assert len({each.symbol for each in displays}) == len({each.label for each in displays}) == 4


@pytest.mark.parametrize(
    ("states", "text"),
    [
        ((None, None), "tip"),
        ((Activation.OFF, Activation.OFF), "tip, cautery off"),
        ((Activation.OFF, Activation.UNKNOWN), "tip, cautery unknown"),
        ((Activation.ON, Activation.UNKNOWN), "tip, cautery on"),
        ((Activation.OFF, Activation.ON), "tip, cautery on"),
    ],
)
def test_breach_says_whether_the_cautery_was_on(tumor, states, text):
    """It changes neither the number nor the depth of breaches."""
    log, plain = (BreachLog(tumor, STALE_NS, {}) for _ in range(2))
    for index, state in enumerate(states):
        log.observe(step_of(index, -1.0 - index, activation=state))
        plain.observe(step_of(index, -1.0 - index))
    (entry,), (same,) = log.breaches.entries, plain.breaches.entries
    assert entry.tool_text == text
    assert replace(entry, activation=None) == same


CENTRE_MM = np.array([10.0, 0.0, -3.0])
FLIPPED = np.diag([-1.0, -1.0, 1.0])
"""The tumour's axes are left, posterior and superior."""


@pytest.mark.parametrize(
    ("direction", "axes", "words"),
    [
        ((1.0, 0.0, 0.0), None, "right"),
        ((0.1, -2.0, 1.2), None, "posterior superior"),
        ((1.0, 0.0, 0.0), FLIPPED, "left"),
        ((0.0, -2.0, 1.2), FLIPPED, "anterior superior"),
        ((0.0, 0.0, 0.0), None, ""),
        ((np.nan, 0.0, 0.0), None, ""),
    ],
)
def test_place_is_named_by_the_axes(direction, axes, words):
    assert anatomical_words(place_letters(np.array(direction), axes)) == words


@pytest.mark.parametrize("matrix", [np.eye(4), np.diag([1.0, 1.0, -1.0]), 2.0 * np.eye(3)])
def test_axes_that_are_no_rotation_are_refused(matrix):
    with pytest.raises(InputError, match="expected"):
        checked_axes(matrix)


def test_tip_ends_2_mm_behind_its_point():
    assert is_tip(2.0) and not is_tip(2.01)


def test_centre_of_a_surface_does_not_depend_on_its_triangles():
    box = trimesh.creation.box((4.0, 6.0, 8.0))
    fine = box.subdivide(np.flatnonzero(box.face_normals[:, 0] > 0.5))
    for mesh in (box, fine):
        surface = SurfaceMesh("tumor", mesh.vertices + CENTRE_MM, mesh.faces)
        np.testing.assert_allclose(surface.centroid_mm, CENTRE_MM, atol=1e-12)


def rgb(text: str) -> Rgb:
    red, green, blue = (int(text[n : n + 2], 16) / 255.0 for n in (1, 3, 5))
    return (red, green, blue)


def test_latched_hold_is_the_state_unless_the_margin_is_worse():
    hold = SHOWN_STATES[HOLD]
    for key, margin in SHOWN_STATES.items():
        if key == HOLD:
            continue
        assert banner_states(margin, latched=False) == (margin, None)
        is_worse = key in ("POSITIVE", "UNKNOWN")
        expected = (margin, hold) if is_worse else (hold, margin)
        assert banner_states(margin, latched=True) == expected


@pytest.mark.parametrize("vision", VISIONS)
def test_states_differ_in_luminance_and_their_text_is_readable(vision):
    """Colour of the ground; of STOP and HOLD, which both forbid to approach, of the text on it."""
    for first, second in combinations(SHOWN_STATES.values(), 2):
        if {first.key, second.key} == {STOP, HOLD}:
            ratio = seen_ratio(rgb(first.text_hex), rgb(second.text_hex), vision)
        else:
            ratio = seen_ratio(rgb(first.ground_hex), rgb(second.ground_hex), vision)
        assert ratio >= 1.5
    for shown in SHOWN_STATES.values():
        assert seen_ratio(rgb(shown.text_hex), rgb(shown.ground_hex), vision) >= 4.5


def test_symbols_and_labels_are_unique():
    assert len({shown.symbol for shown in SHOWN_STATES.values()}) == len(SHOWN_STATES)
    assert len({shown.label for shown in SHOWN_STATES.values()}) == len(SHOWN_STATES)
    assert SHOWN_STATES[STOP].label.isascii() and SHOWN_STATES[STOP].label.isupper()
