"""An operator's command changes session, content and outputs together, or nothing."""

from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from app.fixture import NotRearmableError, TipProximity
from app.geometry import FrameError, InputError, MarginGuardError, MeshError, SurfaceMesh, Transform
from app.registration import given_registration
from app.runtime import OperatorCommands
from app.session import Session, SessionSetup
from tests.doubles import PARAMETERS, AnalyticSphere
from tests.session_content import FACES, TETRAHEDRON, one_link_content

CONTENT = one_link_content()
TOOL_EDGE, TUMOR_EDGE, BASE_EDGE = CONTENT.static_edges
LARGER = SurfaceMesh("tumor", 2.0 * TETRAHEDRON, FACES)
MOVED_TUMOR = Transform("needle", "tumor", np.eye(3), [4.0, 5.0, 6.0])
MOVED_BASE = Transform("reference", "robot_base", np.eye(3), [400.0, 0.0, -200.0])
APPLIED = ["revoke first", "revoke second", "switch first", "switch second"]
PREPARED = ["prepare first", "prepare second"]


class OutputDouble:
    """Test double of an output that appends each call to ``events``."""

    def __init__(self, name, events):
        self.name, self.events = name, events
        self.error = None
        self.content = None

    def publish(self, step, timing):
        raise AssertionError("a command publishes no step")

    def prepare(self, content):
        self.events.append(f"prepare {self.name}")
        if self.error is not None:
            raise self.error
        return self._switch

    def revoke(self):
        self.events.append(f"revoke {self.name}")

    def end(self):
        raise AssertionError("a command ends no output")

    def _switch(self, content):
        self.events.append(f"switch {self.name}")
        self.content = content


class World:
    """A session with two outputs; ``events`` are the calls of the outputs and of the lock."""

    def __init__(self, *, robot=CONTENT.robot, content=CONTENT, proximity=None):
        self.events = []
        proximity = proximity or AnalyticSphere(10.0)
        self.session = Session(SessionSetup(TOOL_EDGE, TUMOR_EDGE, proximity, PARAMETERS, robot))
        self.setup = self.session.setup
        self.outputs = tuple(OutputDouble(name, self.events) for name in ("first", "second"))
        self.commands = OperatorCommands(self.between_steps, content, self.outputs)
        self.content = content

    @contextmanager
    def between_steps(self):
        self.events.append("lock")
        try:
            yield self.session
        finally:
            self.events.append("unlock")

    @property
    def output_events(self):
        return [event for event in self.events if "lock" not in event]

    def assert_unchanged(self):
        assert self.session.setup is self.setup
        assert self.commands.content is self.content
        assert not {*APPLIED} & {*self.events}
        assert self.events.count("lock") == self.events.count("unlock")


@pytest.fixture
def world():
    return World()


def test_margins_change_session_content_and_outputs(world):
    margins = PARAMETERS.replaced(stop_mm=2.0, warn_mm=6.0)
    world.commands.set_margins(margins)
    assert world.session.setup.margins == margins
    assert world.commands.content.margins == margins
    assert all(output.content is world.commands.content for output in world.outputs)
    assert world.output_events == [*PREPARED, *APPLIED]


def test_tumour_is_prepared_before_lock_and_revoked_before_switch(world):
    model_id = world.commands.set_tumor(MOVED_TUMOR, LARGER)
    # The first lock reads the setup.
    assert world.events == ["lock", "unlock", *PREPARED, "lock", *APPLIED, "unlock"]
    content = world.commands.content
    assert content.tumor is LARGER
    assert content.model_id == model_id != CONTENT.model_id
    assert content.static_edges == (TOOL_EDGE, BASE_EDGE, MOVED_TUMOR)
    assert world.session.setup.frame_from_tumor is MOVED_TUMOR
    assert world.session.setup.proximity is not world.setup.proximity
    assert all(output.content is content for output in world.outputs)


def test_tumour_of_tip_only_session_needs_no_tool():
    tumor = SurfaceMesh("tumor", TETRAHEDRON, FACES)
    world = World(content=replace(CONTENT, tool=None), proximity=TipProximity(tumor))
    world.commands.set_tumor(TUMOR_EDGE, LARGER)
    assert isinstance(world.session.setup.proximity, TipProximity)
    assert world.commands.content.tumor is LARGER


@pytest.mark.parametrize(
    ("edge", "tumor", "error", "message"),
    [
        (Transform.identity("reference", "tumor"), LARGER, FrameError, "expected 'needle'"),
        (Transform.identity("needle", "lesion"), LARGER, FrameError, "tumour"),
        (TUMOR_EDGE, SurfaceMesh("tumor", TETRAHEDRON, FACES[:3]), MeshError, "open|closed"),
    ],
    ids=["other frame", "other name", "open surface"],
)
def test_refused_tumour_changes_nothing_and_calls_no_output(world, edge, tumor, error, message):
    with pytest.raises(error, match=message):
        world.commands.set_tumor(edge, tumor)
    world.assert_unchanged()
    assert world.output_events == []


def test_tumour_surface_in_other_frame_changes_nothing(world):
    with pytest.raises(FrameError):
        world.commands.set_tumor(TUMOR_EDGE, SurfaceMesh("needle", TETRAHEDRON, FACES))
    world.assert_unchanged()


def test_tumour_without_tool_surface_is_refused():
    world = World(content=replace(CONTENT, tool=None))
    with pytest.raises(InputError, match="expected a session with a tool mesh"):
        world.commands.set_tumor(TUMOR_EDGE, LARGER)
    world.assert_unchanged()
    assert world.output_events == []


def test_registration_changes_robot_and_static_edge(world):
    registration = given_registration(MOVED_BASE)
    registration_id = world.commands.set_registration(registration)
    assert world.output_events == [*PREPARED, *APPLIED]
    content = world.commands.content
    assert content.registration is registration
    assert content.registration_id == registration_id != CONTENT.registration_id
    assert content.static_edges == (TOOL_EDGE, TUMOR_EDGE, MOVED_BASE)
    assert world.session.setup.robot.registration is registration


def test_refused_registration_changes_nothing_and_calls_no_output(world):
    refused = replace(given_registration(MOVED_BASE), accepted=False, reason="too few points")
    with pytest.raises(InputError, match="too few points"):
        world.commands.set_registration(refused)
    world.assert_unchanged()
    assert world.output_events == []


@pytest.mark.parametrize("frames", [("tracker", "robot_base"), ("reference", "other_base")])
def test_registration_between_other_frames_changes_nothing_and_calls_no_output(world, frames):
    other = given_registration(Transform.identity(*frames))
    with pytest.raises(FrameError):
        world.commands.set_registration(other)
    world.assert_unchanged()
    assert world.output_events == []


def test_registration_without_robot_changes_nothing_and_calls_no_output():
    world = World(robot=None)
    with pytest.raises(InputError, match="the session has no robot; expected one"):
        world.commands.set_registration(given_registration(MOVED_BASE))
    world.assert_unchanged()
    assert world.output_events == []


@pytest.mark.parametrize(
    "change",
    [
        lambda commands: commands.set_margins(PARAMETERS.replaced(stop_mm=2.0, warn_mm=6.0)),
        lambda commands: commands.set_tumor(MOVED_TUMOR, LARGER),
        lambda commands: commands.set_registration(given_registration(MOVED_BASE)),
    ],
    ids=["margins", "tumour", "registration"],
)
def test_content_that_one_output_refuses_changes_nothing(world, change):
    world.outputs[1].error = MarginGuardError("the second output cannot use it")
    with pytest.raises(MarginGuardError, match="the second output cannot use it"):
        change(world.commands)
    world.assert_unchanged()
    assert world.output_events == PREPARED


def test_rearm_calls_check_between_steps(world):
    def check():
        world.events.append("check")
        raise InputError("the fault was not displayed")

    with pytest.raises(InputError, match="not displayed"):
        world.commands.rearm(check)
    assert world.events == ["lock", "check", "unlock"]


def test_rearm_is_refused_while_state_is_unknown(world):
    with pytest.raises(NotRearmableError):
        world.commands.rearm(lambda: None)
    world.assert_unchanged()
