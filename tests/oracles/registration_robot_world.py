"""Robot-world calibration by OpenCV's closed forms and by scipy's least squares.

Independent of `app.registration.robot_base`: other implementations, and another parametrisation
(rotation vectors) of the same likelihood.
"""

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, Transform
from app.registration import PoseNoise


def opencv_base(robot: list[Transform], sensor: list[Transform], method: int) -> Transform:
    """``reference_from_base`` by OpenCV, which takes cam_from_world and gripper_from_base."""
    world, gripper = [p.inverse() for p in sensor], [p.inverse() for p in robot]
    rotation, translation, _, _ = cv2.calibrateRobotWorldHandEye(
        [p.rotation for p in world],
        [p.translation_mm for p in world],
        [p.rotation for p in gripper],
        [p.translation_mm for p in gripper],
        method=method,
    )
    return Transform("reference", "base", rotation, translation.ravel())


def scipy_robot_world(
    robot: list[Transform],
    sensor: list[Transform],
    noise: PoseNoise,
    start_base: Transform,
    start_mount: Transform,
) -> FloatArray:
    """Maximum-likelihood base and mount (12,): for each a rotation vector, then a translation."""

    def misfit(x: FloatArray) -> FloatArray:
        base, mount = Rotation.from_rotvec(x[:3]), Rotation.from_rotvec(x[6:9])
        rows = []
        for pose, measured in zip(robot, sensor, strict=True):
            rotation = base * Rotation.from_matrix(pose.rotation) * mount
            position = base.apply(pose.rotation @ x[9:] + pose.translation_mm) + x[3:6]
            turn = (Rotation.from_matrix(measured.rotation) * rotation.inv()).as_rotvec()
            rows += [turn / noise.rotation_rad]
            rows += [(measured.translation_mm - position) / noise.translation_mm]
        return np.concatenate(rows)

    start = [
        *start_base.rotation_vector,
        *start_base.translation_mm,
        *start_mount.rotation_vector,
        *start_mount.translation_mm,
    ]
    solution = least_squares(misfit, start, xtol=1e-14, ftol=1e-14, gtol=1e-14, x_scale="jac")
    return np.asarray(solution.x)
