"""Compile and load all that a control step uses, before the first one is due."""

import numpy as np

from app.control.control_file import BASE, RULE_FRAME, ControlDescription
from app.control.controller import JointMeasurement, PoseMeasurement, WrenchMeasurement
from app.fixture import MarginState, PlainConstraint
from app.geometry import NS_PER_MS, Transform

_STEPS = 3
_FAR_MM = 1e4


def warm_up(description: ControlDescription) -> None:
    """Take some steps of a controller of its own, whose decisions nothing uses.

    The first step of a process takes most of a second, in which a constraint would expire.
    """
    controller = description.controller()
    joints = description.tool.joints
    identity = Transform.identity(RULE_FRAME, BASE)
    for number in range(_STEPS):
        now_ns = (number + 1) * NS_PER_MS
        planes = np.array([[0.0, 0.0, 1.0]])
        constraint = PlainConstraint(
            "warm-up", number, RULE_FRAME, now_ns, now_ns + NS_PER_MS, int(MarginState.NEGATIVE),
            False, description.accept_simulated, True, planes, np.array([-_FAR_MM]),
            np.zeros((1, 3)), np.zeros((1, 3)), _FAR_MM, 1.0, 1.0, 1.0, "warm-up",
        )  # fmt: skip
        controller.receive(constraint, now_ns)
        controller.step(
            JointMeasurement(now_ns, joints, (0.0,) * len(joints)),
            WrenchMeasurement(now_ns, np.ones(3), np.zeros(3)),
            PoseMeasurement(now_ns, identity),
            now_ns,
        )
