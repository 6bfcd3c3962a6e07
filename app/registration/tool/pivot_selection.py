"""Selection of the poses of a pivot by their information about the tip.

Two poses determine the tip by their relative rotation alone: subtracting their equations leaves
``(R_i - R_j) tip = t_j - t_i``. How far the sensor moved does not count, so a sensor close to the
tip is as good as one far away. Successive samples of slow motion have correlated errors, so poses
are spaced in angle: as widely as the expected covariance of the tip permits.
"""

import math
from collections.abc import Sequence

import numpy as np

from app.geometry import Transform
from app.registration.errors import ShapeError, TooFewError
from app.registration.poses import PoseNoise, PoseStack, select_poses
from app.registration.tool.pivot import MIN_POSES
from app.registration.tool.pivot_fit import fit_linear, jacobian_of

SPACINGS_RAD = tuple(math.radians(value) for value in (5.0, 3.5, 2.5, 1.75, 1.25, 0.9, 0.6))
"""Angles between selected poses, widest first. Below the last one, noise of a tracker counts as
rotation."""

EXPECTED_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)
"""Noise of an electromagnetic tracker, for the expected covariance."""


def select_pivot_poses(
    poses: Sequence[Transform], *, max_tip_sigma_mm: float = 0.25
) -> tuple[int, ...]:
    """Return indices of poses at the widest spacing that is expected to determine the tip.

    The expected sigma of the tip is to be at most ``max_tip_sigma_mm``; without such a spacing the
    narrowest is used, and the fit decides. Raises `TooFewError` for fewer than 10 poses even at the
    narrowest spacing.
    """
    if not (math.isfinite(max_tip_sigma_mm) and max_tip_sigma_mm > 0.0):
        raise ShapeError(
            f"max_tip_sigma_mm is {max_tip_sigma_mm}; expected a finite number above 0"
        )
    selected: tuple[int, ...] = ()
    for spacing in SPACINGS_RAD:
        selected = select_poses(poses, min_distance_mm=0.0, min_angle_rad=spacing)
        if expected_tip_sigma_mm([poses[index] for index in selected]) <= max_tip_sigma_mm:
            return selected
    if len(selected) < MIN_POSES:
        turn = max(pose.angle_to(poses[0]) for pose in poses)
        raise TooFewError(
            f"{len(selected)} poses for a pivot, of {len(poses)} samples that turn by at most "
            f"{math.degrees(turn):.3g} degrees from the first; expected at least {MIN_POSES} that "
            f"differ by {math.degrees(SPACINGS_RAD[-1]):g} degrees"
        )
    return selected


def expected_tip_sigma_mm(poses: Sequence[Transform], noise: PoseNoise = EXPECTED_NOISE) -> float:
    """Expected 3-D RMS error of the tip from ``poses`` with ``noise``; infinite if undetermined."""
    if len(poses) < MIN_POSES:
        return math.inf
    stack = PoseStack(
        poses[0].target,
        poses[0].source,
        np.stack([pose.rotation for pose in poses]),
        np.stack([pose.translation_mm for pose in poses]),
    )
    jacobian = jacobian_of(fit_linear(stack, noise), stack).reshape(-1, 6)
    information = jacobian.T @ jacobian
    if np.linalg.cond(information) > 1e12:
        return math.inf
    return math.sqrt(float(np.trace(np.linalg.inv(information)[:3, :3])))
