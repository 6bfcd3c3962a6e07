"""An arm with kinematics in closed form, and a simulation that the tests share."""

import math
from collections.abc import Mapping

import numpy as np
import pytest

from app.geometry import Transform
from app.synthetic import BASE_FRAME, TIP_FRAME, simulate

POINTING_DOWN = np.diag([-1.0, 1.0, -1.0])


class GantryArm:
    """Test double of `TouchArm`: three prismatic joints (m), then three revolute ones."""

    joint_names = ("x", "y", "z", "yaw", "pitch", "roll")

    def base_from_tool(self, joints: Mapping[str, float]) -> Transform:
        (sy, cy), (sp, cp), (sr, cr) = (
            (math.sin(joints[name]), math.cos(joints[name])) for name in ("yaw", "pitch", "roll")
        )
        turned = np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )
        slides_mm = [1000.0 * joints[name] for name in "xyz"]
        return Transform(BASE_FRAME, TIP_FRAME, turned @ POINTING_DOWN, np.array(slides_mm))

    def joints_for(self, base_from_tool, seed):
        assert (base_from_tool.target, base_from_tool.source) == (BASE_FRAME, TIP_FRAME)
        turned = base_from_tool.rotation @ POINTING_DOWN
        yaw = math.atan2(turned[1, 0], turned[0, 0])
        pitch = math.asin(min(max(-turned[2, 0], -1.0), 1.0))
        roll = math.atan2(turned[2, 1], turned[2, 2])
        values = [*(base_from_tool.translation_mm / 1000.0), yaw, pitch, roll]
        return dict(zip(self.joint_names, map(float, values), strict=True))


@pytest.fixture(scope="session")
def gantry():
    return GantryArm()


@pytest.fixture(scope="session")
def simulation(gantry):
    return simulate(gantry, np.random.default_rng([1, 0]))
