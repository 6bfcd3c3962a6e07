"""An arm with kinematics in closed form, and a simulation that the tests share."""

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.geometry import Transform
from app.synthetic import BASE_FRAME, TIP_FRAME, simulate

POINTING_DOWN = np.diag([-1.0, 1.0, -1.0])


class GantryArm:
    """Three prismatic joints (m), then three revolute ones: kinematics in closed form."""

    joint_names = ("x", "y", "z", "yaw", "pitch", "roll")

    def base_from_tool(self, joints: Mapping[str, float]) -> Transform:
        turns = [joints[name] for name in ("yaw", "pitch", "roll")]
        rotation = Rotation.from_euler("ZYX", turns).as_matrix() @ POINTING_DOWN
        slides_mm = [1000.0 * joints[name] for name in "xyz"]
        return Transform(BASE_FRAME, TIP_FRAME, rotation, np.array(slides_mm))

    def joints_for(self, base_from_tool, seed):
        assert (base_from_tool.target, base_from_tool.source) == (BASE_FRAME, TIP_FRAME)
        turns = Rotation.from_matrix(base_from_tool.rotation @ POINTING_DOWN.T).as_euler("ZYX")
        values = [*(base_from_tool.translation_mm / 1000.0), *turns]
        return dict(zip(self.joint_names, map(float, values), strict=True))


@pytest.fixture(scope="session")
def gantry():
    return GantryArm()


@pytest.fixture(scope="session")
def simulation(gantry):
    return simulate(gantry, np.random.default_rng([1, 0]))
