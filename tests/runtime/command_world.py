"""A session whose outputs record the calls of an operator's commands."""

from contextlib import contextmanager
from dataclasses import replace
from itertools import count

import numpy as np

from app.geometry import SurfaceMesh, Transform
from app.registration import DriftBound
from app.runtime import ITEM_COMMANDS, ImageDepth, OperatorCommands, ShownItem, StepHolds
from app.session import Session, SessionSetup
from tests.doubles import PARAMETERS, AnalyticSphere
from tests.session_content import FACES, TETRAHEDRON, one_link_content

CONTENT = one_link_content()
TOOL_EDGE, TUMOR_EDGE, BASE_EDGE = CONTENT.static_edges
ROBOT = replace(CONTENT.robot, max_drift=DriftBound(1e4, 4.0))
LARGER = SurfaceMesh("tumor", 2.0 * TETRAHEDRON, FACES)
MOVED_TUMOR = Transform("needle", "tumor", np.eye(3), [4.0, 5.0, 6.0])
MOVED_BASE = Transform("reference", "robot_base", np.eye(3), [400.0, 0.0, -200.0])
PREPARED = ["prepare first", "prepare second"]
LATCHED = ["latch first", "latch second"]
SWITCHED = ["switch first", "switch second"]
APPLIED = ["revoke first", "revoke second", *SWITCHED]
STYLUS = ShownItem("stylus", "pointer")
STYLUS_TIP = Transform("pointer", "pointer_tip", np.eye(3), [1.0, 2.0, 140.0])
DEPTHS = ImageDepth((40.0, 60.0), 40.0)
MOUNTED = replace(ROBOT, link_from_tip=Transform.identity("base_link", "cautery_tip"))
OTHER_TIP = Transform("cautery", "cautery_tip", np.eye(3), [3.0, 0.0, 124.0])
NEEDLE = ShownItem(
    "needle", "needle", 60.0, Transform("needle", "needle_tip", np.eye(3), [0.0, 0.0, 60.0])
)
LengthenNeedle, SetStylusTip = ITEM_COMMANDS["needle"], ITEM_COMMANDS["stylus"]


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

    def latch(self, causes):
        self.events.append(f"latch {self.name}")
        self.causes = causes

    def end(self):
        raise AssertionError("a command ends no output")

    def _switch(self, content):
        self.events.append(f"switch {self.name}")
        self.content = content


class World:
    """A session with two outputs; ``events`` are the calls of the outputs and of the lock."""

    def __init__(self, *, robot=ROBOT, proximity=None, **content):
        self.events = []
        proximity = proximity or AnalyticSphere(10.0)
        self.content = replace(CONTENT, robot=robot, **content)
        base = SessionSetup(TOOL_EDGE, TUMOR_EDGE, proximity, PARAMETERS, robot)
        self.session = Session(self.content.setup(base))
        self.setup = self.session.setup
        self.outputs = tuple(OutputDouble(name, self.events) for name in ("first", "second"))
        self.holds = StepHolds()
        outputs = (self.holds, *self.outputs)
        self.commands = OperatorCommands(
            self.between_steps, self.content, outputs, holds=self.holds
        )
        self.frames = count()

    def use_commands(self, **options):
        """Commands with other options; `holds` is no output of them."""
        options = {"holds": self.holds, **options}
        self.commands = OperatorCommands(self.between_steps, self.content, self.outputs, **options)
        return self.commands

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

    def assert_used_by_outputs(self):
        assert all(output.content is self.commands.content for output in self.outputs)

    def assert_only_shown_content_changed(self):
        assert self.output_events == [*PREPARED, *SWITCHED]
        self.assert_used_by_outputs()
        assert self.session.setup is self.setup
        assert self.session.hold_causes == ()

    def assert_unchanged(self):
        assert self.session.setup is self.setup
        assert self.commands.content is self.content
        assert not {*APPLIED} & {*self.events}
        assert self.events.count("lock") == self.events.count("unlock")
