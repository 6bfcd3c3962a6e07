"""An operator's command changes session, content and outputs together, or nothing."""

import threading
from dataclasses import asdict
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from app.case import MarginEntry
from app.fixture import MarginState, TipProximity
from app.geometry import InputError, MarginGuardError, MeshError, SurfaceMesh, Transform
from app.hold import NotRearmableError, RearmRefusedError, SeenHold
from app.registration import given_registration
from app.runtime import ChooseDepth, ImageDepth, LocalOperator, SetTip
from app.runtime.operator_command import COMMANDS
from app.runtime.requests import ADMITTED, KINDS, RequestKind
from tests.doubles import PARAMETERS, frame, joint_sample, sample
from tests.runtime.command_world import (
    APPLIED,
    BASE_EDGE,
    CONTENT,
    DEPTHS,
    LARGER,
    LATCHED,
    MOUNTED,
    MOVED_BASE,
    MOVED_TUMOR,
    NEEDLE,
    OTHER_TIP,
    PREPARED,
    STYLUS,
    STYLUS_TIP,
    TOOL_EDGE,
    TUMOR_EDGE,
    LengthenNeedle,
    SetStylusTip,
    World,
)
from tests.session_content import FACES, TETRAHEDRON

ALL_COMMANDS = pytest.mark.parametrize(
    "command",
    [
        lambda commands: commands.set_margins(
            PARAMETERS.replaced(stop_mm=2.0, warn_mm=6.0), origin="a test"
        ),
        lambda commands: commands.set_tumor(MOVED_TUMOR, LARGER, origin="a test"),
        lambda commands: commands.set_registration(given_registration(MOVED_BASE), origin="a test"),
    ],
    ids=["margins", "tumour", "registration"],
)


@pytest.fixture
def world():
    return World()


def test_length_of_the_needle_changes_only_what_is_shown():
    world = World(items=(NEEDLE,))
    LocalOperator(world.commands, "a test").request(LengthenNeedle(5.0))
    world.assert_only_shown_content_changed()
    content = world.commands.content
    needle = content.item("needle")
    assert needle.length_mm == 65.0
    assert needle.frame_from_tip.translation_mm.tolist() == [0.0, 0.0, 65.0]
    assert np.ptp(needle.surface.vertices_mm[:, 2]) == 65.0
    assert content.values(world.content).items == {"needle": {"length_mm": 65.0}}
    assert content.replaced_since(world.content) == ("needle",)
    assert (content.model_id, content.margins) == (world.content.model_id, world.content.margins)
    assert world.commands.requests.last.line.endswith("from a test accepted: from 60 to 65 mm")


def test_tip_of_the_stylus_changes_neither_the_tool_nor_the_session():
    world = World(items=(NEEDLE, STYLUS))
    LocalOperator(world.commands, "a test").request(SetStylusTip(STYLUS_TIP, 0.3))
    world.assert_only_shown_content_changed()
    content = world.commands.content
    assert content.tool_from_tip is world.content.tool_from_tip
    assert content.tip_sigma_mm == world.content.tip_sigma_mm
    assert content.margins is world.content.margins
    stylus = content.item("stylus")
    assert (stylus.frame_from_tip, stylus.sigma_mm) == (STYLUS_TIP, 0.3)
    assert np.ptp(stylus.surface.vertices_mm[:, 2]) == pytest.approx(140.0, abs=0.1)
    assert content.item("needle") is NEEDLE
    values = content.values(world.content).items["stylus"]
    matrix = STYLUS_TIP.matrix.ravel().tolist()
    assert values == {"tip_from": {"matrix": matrix}, "sigma_mm": 0.3}
    assert content.replaced_since(world.content) == ("stylus",)
    request = world.commands.requests.last.line
    assert request == "set_stylus_tip from a test accepted: the first tip, sigma 0.30 mm"
    moved = Transform("pointer", "pointer_tip", np.eye(3), [1.0, 2.0, 142.0])
    LocalOperator(world.commands, "a test").request(SetStylusTip(moved, 0.2))
    assert "the tip is moved by 2.00 mm" in world.commands.requests.last.text


def test_depth_of_the_images_changes_only_how_they_are_placed():
    world, recorder = World(image_depth=DEPTHS), RecorderDouble()
    world.use_commands(recorder=recorder)
    LocalOperator(world.commands, "a test").request(ChooseDepth(60.0))
    world.assert_only_shown_content_changed()
    content = world.commands.content
    assert content.image_depth == ImageDepth((40.0, 60.0), 60.0)
    assert content.values(world.content).image_depth_mm == 60.0
    assert recorder.depths == 1 and recorder.noted == [()]
    line = world.commands.requests.last.line
    assert line == "image_depth from a test accepted: from 40 to 60 mm"


def test_tumour_is_prepared_before_lock_and_revoked_before_switch(world):
    model_id = world.commands.set_tumor(MOVED_TUMOR, LARGER, origin="a test")
    # The first lock reads the setup.
    assert world.events == ["lock", "unlock", *PREPARED, "lock", *APPLIED, *LATCHED, "unlock"]
    content = world.commands.content
    assert content.tumor is LARGER
    assert content.model_id == model_id != CONTENT.model_id
    assert content.static_edges == (TOOL_EDGE, BASE_EDGE, MOVED_TUMOR)
    assert world.session.setup.frame_from_tumor is MOVED_TUMOR
    assert world.session.setup.proximity is not world.setup.proximity
    assert all(output.content is content for output in world.outputs)


def test_uncertainty_of_a_tumour_enters_session_and_content_and_is_named(world):
    world.commands.set_tumor(TUMOR_EDGE, LARGER, sigma_mm=0.6, origin="a test")
    assert world.session.setup.tumor_sigma_mm == 0.6
    assert world.commands.content.tumor_sigma_mm == 0.6
    assert "uncertainty from 0.00 to 0.60 mm" in world.session.hold_causes[0]
    world.commands.set_tumor(TUMOR_EDGE, LARGER, origin="a test")
    assert world.session.setup.tumor_sigma_mm == 0.0


def test_tip_is_used_by_session_content_and_outputs_and_latches_a_hold(world):
    assert LocalOperator(world.commands, "a test").request(SetTip(OTHER_TIP, 0.2)) == ""
    assert world.output_events == [*PREPARED, *APPLIED, *LATCHED]
    assert world.session.setup.tool_from_tip is OTHER_TIP
    assert world.session.setup.tip_sigma_mm == world.commands.content.tip_sigma_mm == 0.2
    assert world.commands.content.tool_from_tip is OTHER_TIP
    assert world.session.setup.proximity is world.setup.proximity
    cause = "calibration of the tool replaced: the tip is moved by 5.00 mm"
    assert world.session.hold_causes[0].startswith(cause)
    request = world.commands.requests.last
    assert (request.kind, request.accepted) == ("set_tip", True)
    assert "register the robot again" in request.text


def test_uncertainty_of_the_tip_enters_sigma_and_the_pose_is_doubted_until_the_rearm(world):
    tip = Transform("cautery", "cautery_tip", np.eye(3), [0.0, 0.0, 120.0])
    world = World(robot=None)
    for index in range(2):
        known = world.session.step(tracking_frame(index)).decision
    world.commands.set_tip(tip, sigma_mm=0.3, origin="a test")
    held = world.session.step(tracking_frame(2)).decision
    assert held.margin.tre_mm == pytest.approx(known.margin.tre_mm + PARAMETERS.k_tre * 0.3)
    assert held.hold
    assert not held.constraint_is_current


class RecorderDouble:
    """TEST DOUBLE of `CaseRecorder`: keeps what it has to note."""

    status = None

    def __init__(self):
        self.noted, self.values, self.depths = [], [], 0

    def start(self, name, values):
        self.values.append(values)
        return Path("cases", name)

    def note_replaced(self, parts):
        self.noted.append(parts)

    def note_depth(self):
        self.depths += 1


def test_recording_begins_with_the_values_in_use_and_notes_what_is_replaced_later(world):
    recorder = RecorderDouble()
    commands = world.use_commands(recorder=recorder)
    commands.start_recording("a", origin="a test")
    commands.set_tumor(
        TUMOR_EDGE, LARGER, sigma_mm=0.5, origin="a test"
    )  # shown by the ids of the constraint
    commands.set_tip(OTHER_TIP, sigma_mm=0.2, origin="a test")
    margins = PARAMETERS.replaced(stop_mm=2.0, warn_mm=6.0)
    commands.set_margins(margins, origin="a test")
    registration = given_registration(MOVED_BASE)
    commands.set_registration(registration, origin="a test")
    commands.set_tumor(
        TUMOR_EDGE, LARGER, sigma_mm=0.7, origin="a test"
    )  # the same surface: not shown by them
    commands.start_recording("b", origin="a test")
    assert recorder.noted == [(), (), ("tip",), ("margins",), (), ("tumour",), ()]
    first, second = recorder.values
    assert (first.tumor, first.registration, first.tip_sigma_mm) == (None, None, 0.0)
    assert (second.tool_from_tip, second.tip_sigma_mm) == (OTHER_TIP, 0.2)
    assert (second.tumor, second.tumor_sigma_mm) == (LARGER, 0.7)
    assert second.margins == MarginEntry(**asdict(margins))
    assert second.registration.reference_from_base is registration.transform


def test_tip_of_a_mounted_tool_may_be_at_another_place():
    world = World(robot=MOUNTED)
    world.commands.set_tip(OTHER_TIP, origin="a test")
    assert world.session.hold_causes


def test_tumour_of_tip_only_session_needs_no_tool():
    tumor = SurfaceMesh("tumor", TETRAHEDRON, FACES)
    world = World(tool=None, proximity=TipProximity(tumor))
    world.commands.set_tumor(TUMOR_EDGE, LARGER, origin="a test")
    assert isinstance(world.session.setup.proximity, TipProximity)
    assert world.commands.content.tumor is LARGER


def test_registration_changes_robot_and_static_edge(world):
    registration = given_registration(MOVED_BASE)
    registration_id = world.commands.set_registration(registration, origin="a test")
    assert world.output_events == [*PREPARED, *APPLIED, *LATCHED]
    content = world.commands.content
    assert content.registration is registration
    assert content.registration_id == registration_id != CONTENT.registration_id
    assert content.static_edges == (TOOL_EDGE, TUMOR_EDGE, MOVED_BASE)
    assert world.session.setup.robot.registration is registration


def test_every_kind_of_request_has_a_command_and_a_limit():
    assert {"needle_length", "set_stylus_tip"} < set(KINDS)
    assert set(COMMANDS) == set(KINDS)
    assert set(ADMITTED) == set(KINDS) - {RequestKind.REARM}


@ALL_COMMANDS
def test_content_that_one_output_refuses_changes_nothing(world, command):
    world.outputs[1].error = MarginGuardError("the second output cannot use it")
    with pytest.raises(MarginGuardError, match="the second output cannot use it"):
        command(world.commands)
    world.assert_unchanged()
    assert world.output_events == PREPARED


class HoldsDouble:
    """Test double of `Holds`: appends its calls to ``events``; refuses with ``error``."""

    def __init__(self, events):
        self.events, self.error = events, None

    def present(self):
        return SeenHold(7, 9)

    def check(self, seen):
        self.events.append(f"check {seen.nonce}")
        if self.error is not None:
            raise self.error

    def consume(self, seen):
        self.events.append(f"consume {seen.nonce}")


def test_rearm_is_checked_between_steps_and_ends_no_other_hold(world):
    holds = HoldsDouble(world.events)
    holds.error = RearmRefusedError("nonce is 9: not that of the present hold")
    commands = world.use_commands(holds=holds)
    with pytest.raises(RearmRefusedError, match="nonce is 9"):
        commands.rearm(SeenHold(7, 9), origin="a test")
    assert world.events == ["lock", "check 9", "unlock"]
    assert (commands.requests.last.kind, commands.requests.last.accepted) == ("rearm", False)


def test_rearm_is_refused_while_state_is_unknown_and_keeps_the_nonce(world):
    commands = world.use_commands(holds=HoldsDouble(world.events))
    with pytest.raises(NotRearmableError):
        commands.rearm(SeenHold(7, 9), origin="a test")
    assert "consume 9" not in world.events
    world.assert_unchanged()


def known(world):
    """Take steps until the margin of the session is known; its robot stands still elsewhere."""
    for index in islice(world.frames, 6):
        step = world.session.step(tracking_frame(index))
        world.holds.publish(step, None)
    assert step.decision.state is MarginState.NEGATIVE
    return step


def tracking_frame(index):
    at_ms = 1000 + 20 * index
    return frame(
        at_ms,
        sample("tracker", "needle", (0.0, 0.001 * index, 0.0), at_ms),
        sample("tracker", "cautery", (0.001 * index, 0.0, 60.0), at_ms),
        sample("tracker", "reference", (0.0, 0.001 * index, 0.0), at_ms),
        joints=(joint_sample({}, at_ms),),
    )


def test_looser_margins_latch_a_hold_and_apply_with_its_rearm(world):
    known(world)
    looser = PARAMETERS.replaced(stop_mm=0.5, stale_after_ns=10_000_000_000)
    world.commands.set_margins(looser, origin="a test")
    assert world.output_events == [*PREPARED, *APPLIED, *LATCHED]
    text = f"stop_mm lowered from {PARAMETERS.stop_mm:g} to 0.5, stale_after_ms raised from "
    assert world.outputs[0].causes[0].startswith(text)
    assert world.commands.content.margins == PARAMETERS == world.session.setup.margins
    assert world.session.requested.margins == looser
    step = known(world)
    assert step.decision.hold
    assert step.hold_causes == world.outputs[0].causes
    world.commands.rearm(world.commands.seen(), origin="a test")
    assert world.commands.content.margins == looser == world.session.setup.margins
    world.assert_used_by_outputs()
    assert not known(world).decision.hold


def test_nonce_of_a_hold_dies_with_the_next_loosening_before_any_step(world):
    known(world)
    world.commands.set_margins(PARAMETERS.replaced(stop_mm=0.5), origin="a test")
    known(world)
    seen = world.commands.seen()
    world.commands.set_margins(PARAMETERS.replaced(stop_mm=0.25), origin="a test")
    with pytest.raises(RearmRefusedError, match="not that of the present hold"):
        world.commands.rearm(seen, origin="a test")
    assert world.session.setup.margins == PARAMETERS


def test_tightening_needs_no_rearm(world):
    known(world)
    tighter = PARAMETERS.replaced(stop_mm=2.0, warn_mm=9.0, stale_after_ns=20_000_000)
    world.commands.set_margins(tighter, origin="a test")
    assert world.session.setup.margins == tighter == world.commands.content.margins
    world.assert_used_by_outputs()
    assert world.output_events == [*PREPARED, *APPLIED]
    assert not known(world).decision.hold


def test_new_tumour_is_described_in_the_hold_and_in_the_request(world):
    known(world)
    world.commands.set_tumor(TUMOR_EDGE, LARGER, origin="a test")
    (cause,) = world.outputs[0].causes
    assert "THE VOLUME DIFFERS BY MORE THAN A FACTOR OF 2" in cause
    assert cause in world.commands.requests.last.text
    # A later change does not hide the earlier one.
    world.commands.set_margins(PARAMETERS.replaced(k_tre=0.0), origin="a test")
    assert [each.partition(" ")[0] for each in world.outputs[0].causes] == ["k_tre", "tumour"]


def test_tumour_with_too_many_triangles_is_refused(world):
    commands = world.use_commands(max_triangles=3)
    with pytest.raises(InputError, match="has 4 triangles; expected at most 3 in a live session"):
        commands.set_tumor(TUMOR_EDGE, LARGER, origin="a test")
    world.assert_unchanged()


def test_every_command_is_listed_with_its_origin(world):
    listed = []
    world.commands.requests.listen(listed.append)
    world.commands.set_margins(PARAMETERS.replaced(stop_mm=2.0), origin="panel")
    with pytest.raises(MeshError):
        world.commands.set_tumor(
            TUMOR_EDGE, SurfaceMesh("tumor", TETRAHEDRON, FACES[:3]), origin="a test"
        )
    assert [(each.kind, each.origin, each.accepted) for each in listed] == [
        ("set_margins", "panel", True),
        ("set_tumor", "a test", False),
    ]
    assert listed[0].line.startswith("set_margins from panel accepted: stop_mm raised from ")
    assert listed[1].line.startswith("set_tumor from a test REFUSED: ")


@ALL_COMMANDS
def test_outputs_are_prepared_while_the_session_steps(world, command):
    command(world.commands)
    prepared = [world.events.index(event) for event in PREPARED]
    assert all(
        world.events[:at].count("lock") == world.events[:at].count("unlock") for at in prepared
    )
    assert max(prepared) < world.events.index(APPLIED[0])


def test_margins_are_refused_at_once_while_a_tumour_is_prepared(world):
    """The thread that receives the poses calls it for a parameter, and must not wait."""
    entered, leave = threading.Event(), threading.Event()
    prepare = world.outputs[0].prepare

    def slow_prepare(content):
        entered.set()
        assert leave.wait(60.0)
        return prepare(content)

    world.outputs[0].prepare = slow_prepare
    change = threading.Thread(
        target=world.commands.set_tumor, args=(MOVED_TUMOR, LARGER), kwargs={"origin": "a test"}
    )
    change.start()
    assert entered.wait(60.0)
    before = world.session.setup.margins
    with pytest.raises(InputError, match="another change is being prepared"):
        world.commands.set_margins(before.replaced(stop_mm=2.0, warn_mm=6.0), origin="a test")
    assert world.session.setup.margins == before
    leave.set()
    change.join(60.0)
    assert world.commands.content.tumor is LARGER
