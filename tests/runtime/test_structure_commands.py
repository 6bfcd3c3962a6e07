"""Structures beside the tumour are set and switched by an operator while the session runs."""

from dataclasses import replace

import numpy as np
import pytest

from app.fixture import MarginState, Reason
from app.geometry import FrameError, InputError, MeshError, SurfaceMesh, Transform
from app.runtime import LocalOperator, SetStructure, SwitchStructure
from app.runtime.session_changes import MAX_REASON
from app.session import Role, Session
from tests.doubles import frame, sample
from tests.runtime.command_world import APPLIED, LATCHED, PREPARED, World
from tests.session_content import FACES, TETRAHEDRON

pytestmark = pytest.mark.slow

NAN = float("nan")
REASON = "resected"


def vessel(**changes):
    """The command that guards a vessel 40 mm beside the tumour."""
    name, frame_id = changes.pop("name", "vessel"), changes.pop("frame", "needle")
    values = {
        "frame_from_structure": Transform(frame_id, name, np.eye(3), [40.0, 0.0, 0.0]),
        "surface": SurfaceMesh(name, TETRAHEDRON, FACES),
        "role": Role.FORBIDDEN,
        "stop_mm": 1.0,
        "warn_mm": 3.0,
        "sigma_mm": 0.2,
    }
    return SetStructure(**values | changes)


LARGER = vessel(surface=SurfaceMesh("vessel", 2.0 * TETRAHEDRON, FACES), stop_mm=0.5)
OFF, ON = SwitchStructure("vessel", False, f" {REASON}\n"), SwitchStructure("vessel", True)


@pytest.fixture
def world():
    return World(robot=None)


def request(world, *commands):
    return [LocalOperator(world.commands, "a test").request(each) for each in commands]


def steps(world, count=6, known=("needle", "cautery", "reference")):
    """Take steps with the tool beside tumour and vessel; return the last one."""
    for index in (next(world.frames) for _ in range(count)):
        at_ms = 1000 + 20 * index
        places = {
            "needle": (0.0, 1e-3 * index, 0.0),
            "cautery": (1e-3 * index, 0.0, -90.0),
            "reference": (0.0, 1e-3 * index, 0.0),
            "clip": (1e-3 * index, 0.0, 0.0),
        }
        poses = [sample("tracker", each, places[each], at_ms) for each in known]
        step = world.session.step(frame(at_ms, *poses))
        world.holds.publish(step, None)
    return step


def rearm(world):
    world.commands.rearm(world.commands.seen(), origin="a test")
    return steps(world)


def test_added_structure_is_guarded_from_the_next_step_without_a_hold(world):
    assert not steps(world).decision.hold
    (setup_id,) = request(world, vessel())
    assert world.output_events == [*PREPARED, *APPLIED]
    content = world.commands.content
    assert setup_id == content.setup_id != world.content.setup_id
    assert content.structures[0].surface.frame == "vessel"
    step = steps(world, 1)
    assert [each.name for each in step.structures] == ["tumor", "vessel"]
    assert step.decision.state is MarginState.NEGATIVE
    assert not step.decision.hold
    last = world.commands.requests.last
    assert (last.kind, last.accepted) == ("set_structure", True)
    assert last.text.endswith("structure 'vessel' added")


def test_replaced_structure_latches_a_hold_that_compares_both(world):
    request(world, vessel())
    steps(world)
    request(world, LARGER)
    assert world.output_events[-2:] == LATCHED
    (cause,) = world.session.hold_causes
    assert cause.startswith("structure 'vessel' replaced: THE VOLUME DIFFERS BY MORE THAN A FACTOR")
    assert cause.endswith("stop_mm lowered from 1 to 0.5")
    assert world.commands.content.structures[0].stop_mm == 1.0  # until the re-arm
    step = steps(world)
    assert step.decision.hold and not step.decision.constraint_is_current
    assert not rearm(world).decision.hold
    assert world.commands.content.structures[0].stop_mm == 0.5
    world.assert_used_by_outputs()


def test_structure_in_another_frame_is_named_as_replaced(world):
    request(world, vessel(), vessel(frame="reference"))
    (cause,) = world.session.hold_causes
    assert cause == "structure 'vessel' replaced: it moves with 'reference', not 'needle'"


def test_structure_that_is_switched_off_is_listed_with_its_reason_until_it_is_on(world):
    request(world, vessel())
    added = world.commands.content
    steps(world)
    request(world, OFF)
    assert world.session.hold_causes == ("structure 'vessel' switched off: resected",)
    step = steps(world)
    assert step.decision.hold
    assert (step.off, step.structures) == ({"vessel": REASON}, ())
    assert world.commands.content.structures == ()
    assert world.commands.content.static_edges == world.content.static_edges
    assert world.commands.requests.last.text == "structure 'vessel' switched off: resected"
    step = rearm(world)
    assert not step.decision.hold
    assert step.off == {"vessel": REASON}
    (setup_id,) = request(world, ON)
    assert setup_id == added.setup_id
    assert world.commands.content.structures == added.structures
    step = steps(world)
    assert not step.decision.hold
    assert (step.off, len(step.structures)) == ({}, 2)
    assert world.commands.requests.last.text == "structure 'vessel' is guarded again"


def test_structure_that_is_on_again_before_the_rearm_still_needs_it(world):
    request(world, vessel())
    steps(world)
    request(world, OFF, ON)
    step = steps(world)
    assert step.hold_causes == ("a change that loosened the session was undone",)
    assert step.decision.hold
    assert not rearm(world).decision.hold


def test_structure_that_is_added_on_hold_is_named_when_it_changes_before_the_rearm(world):
    steps(world)
    looser = world.session.setup.margins.replaced(stop_mm=0.5)
    world.commands.set_margins(looser, origin="a test")
    request(world, vessel(), LARGER)
    of_margins, replaced = world.session.hold_causes
    assert of_margins.startswith("stop_mm lowered")
    assert replaced.startswith("structure 'vessel' replaced: THE VOLUME DIFFERS")
    request(world, OFF)
    assert world.session.hold_causes == (of_margins, "structure 'vessel' switched off: resected")
    assert steps(world).decision.hold
    assert not rearm(world).decision.hold


def test_structure_that_is_off_may_be_replaced(world):
    request(world, vessel())
    steps(world)
    request(world, OFF)
    steps(world)
    rearm(world)
    request(world, LARGER)
    step = steps(world)
    assert not step.decision.hold
    assert (step.off, len(step.structures)) == ({}, 2)
    with pytest.raises(InputError, match="'vessel': is not off; expected one of the structures"):
        request(world, ON)


def test_session_without_a_structure_again_decides_as_one_that_never_had_it(world):
    request(world, vessel())
    steps(world)
    request(world, OFF)
    steps(world)
    rearm(world)
    other = World(robot=None)
    other.session = Session(other.setup)
    for _ in range(12):
        next(other.frames)
    steps(other)
    for _ in range(5):
        found, expected = steps(world, 1), steps(other, 1)
        assert found.frame.stamp == expected.frame.stamp
        for name in ("state", "reasons", "margin", "hold", "stamp", "constraint_is_current"):
            assert getattr(found.decision, name) == getattr(expected.decision, name)
        np.testing.assert_array_equal(
            found.decision.constraint.rows, expected.decision.constraint.rows
        )


def test_frame_that_nobody_measures_is_unknown_until_it_is_measured(world):
    steps(world)
    request(world, vessel(frame="clip"))
    step = steps(world)
    assert step.decision.state is MarginState.UNKNOWN
    assert step.decision.hold and Reason.LATCHED not in step.decision.reasons
    assert not step.decision.constraint_is_current
    step = steps(world, known=("needle", "cautery", "reference", "clip"))
    assert step.decision.state is MarginState.NEGATIVE
    assert not step.decision.hold


def test_fault_of_the_tumour_latches_the_hold_while_an_added_structure_is_not_measured(world):
    steps(world)
    request(world, vessel(frame="clip"))
    steps(world)
    step = steps(world, 20, known=("cautery", "reference", "clip"))
    assert Reason.LATCHED in step.decision.reasons
    assert steps(world, 20, known=("needle", "cautery", "reference", "clip")).decision.hold


OPEN = SurfaceMesh("vessel", TETRAHEDRON, FACES[:3])
WRONG = {
    "name of the tumour": (vessel(name="tumor"), FrameError, "'tumor': is the tumour; expected"),
    "name of a measured frame": (vessel(name="clip"), FrameError, "the name of another frame"),
    "name of the tool": (vessel(name="cautery"), FrameError, "the name of another frame"),
    "name of the tip": (vessel(name="cautery_tip"), FrameError, "the name of another frame"),
    "its own frame": (vessel(frame="vessel"), FrameError, "that of a structure or of the"),
    "frame of the tool": (vessel(frame="cautery"), FrameError, "does not move with the tool"),
    "frame of the tumour": (vessel(frame="tumor"), FrameError, "that of a structure or of the"),
    "frame of a structure": (vessel(name="a", frame="vessel"), FrameError, "that of a structure"),
    "open surface": (vessel(surface=OPEN), MeshError, "^the mesh of structure 'vessel'"),
    "stop after the warning": (vessel(stop_mm=4.0), InputError, "^structure 'vessel': .*expected"),
    "stop below 0": (vessel(stop_mm=-1.0), InputError, "^structure 'vessel': .*expected"),
    "stop that is no number": (vessel(stop_mm=NAN), InputError, "^structure 'vessel': .*expected"),
    "sigma below 0": (vessel(sigma_mm=-0.1), InputError, "^uncertainty of structure 'vessel': is"),
    "sigma that is no number": (vessel(sigma_mm=NAN), InputError, "expected 0 to 10 mm"),
    "tumour off": (SwitchStructure("tumor", False, "x"), InputError, "'tumor': is the tumour"),
    "unknown off": (SwitchStructure("wall", False, "x"), InputError, "expected one of vessel$"),
    "unknown on": (SwitchStructure("wall", True), InputError, "'wall': is not off; expected"),
    "guarded on": (ON, InputError, "'vessel': is not off; expected one of the structures"),
    "no reason": (replace(OFF, reason=" \n"), InputError, "reason has 0 characters; expected 1 to"),
    "long reason": (replace(OFF, reason="x" * (MAX_REASON + 1)), InputError, "has 201 characters"),
}


@pytest.mark.parametrize(("command", "error", "text"), WRONG.values(), ids=WRONG)
def test_wrong_request_is_refused_in_one_line_and_changes_nothing(command, error, text):
    world = World(robot=None)
    request(world, vessel())
    steps(world, known=("needle", "cautery", "reference", "clip"))
    content, setup = world.commands.content, world.session.setup
    with pytest.raises(error, match=text) as raised:
        request(world, command)
    assert "\n" not in str(raised.value)
    assert world.commands.content is content and world.session.setup is setup
    assert world.session.hold_causes == ()
    last = world.commands.requests.last
    assert (last.kind, last.accepted) == (command.kind, False)


def test_name_of_another_tool_is_refused(world):
    world.session.use(replace(world.session.setup, tool_names=("vessel",)))
    with pytest.raises(FrameError, match=r"^structure 'vessel': has the name of another frame"):
        request(world, vessel())


@pytest.mark.parametrize("name", ["robot_base", "base_link", "cautery"])
def test_name_of_a_frame_is_refused_beside_a_robot(name):
    with pytest.raises(FrameError, match=f"^structure {name!r}: has the name of another frame"):
        request(World(), vessel(name=name))


def test_other_role_is_refused_where_the_command_is_made():
    with pytest.raises(InputError, match=r"^role: is 'organ'; expected one of target, forbidden$"):
        vessel(role="organ")


def test_more_structures_or_triangles_than_allowed_are_refused(world, monkeypatch):
    monkeypatch.setattr("app.runtime.session_changes.MAX_STRUCTURES", 2)
    request(world, vessel(), OFF)
    with pytest.raises(InputError, match="'nerve': the session has 2 structures; expected at most"):
        request(world, vessel(name="nerve"))
    request(world, LARGER)  # in the place of the one that is off
    world.use_commands(max_triangles=3)
    with pytest.raises(InputError, match=r"'wall': has 4 triangles; expected at most 3"):
        monkeypatch.undo()
        request(world, vessel(name="wall"))
