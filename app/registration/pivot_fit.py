"""Numerics of `pivot`: selection of poses, linear start, maximum likelihood, noise estimate.

Poses are selected by their information about the tip. Two poses determine the tip by their relative
rotation alone: subtracting their equations leaves ``(R_i - R_j) tip = t_j - t_i``. How far the
sensor moved does not count, so a sensor close to the tip is as good as one far away. Successive
samples of slow motion have correlated errors, so poses are spaced in angle: as widely as the
expected covariance of the tip permits.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from app.geometry import FloatArray, Transform
from app.registration.input_checks import ConvergenceError, TooFewError
from app.registration.pose_stack import PoseNoise, PoseStack, select_poses

MIN_POSES = 10

NO_ROTATION_NOISE_RAD = 1e-9
NO_TRANSLATION_NOISE_MM = 1e-7
NOMINAL_NOISE = PoseNoise(NO_ROTATION_NOISE_RAD, 0.3)

MAX_NOISE_ROUNDS = 50


@dataclass(frozen=True, slots=True, eq=False)
class PivotFit:
    """Estimate of tip and pivot, (3,) each in mm, and the noise that weights the residuals."""

    tip: FloatArray
    pivot: FloatArray
    noise: PoseNoise

    @property
    def length_mm(self) -> float:
        """Distance from the sensor to the tip, at least 1e-9 for use as a divisor."""
        return max(float(np.linalg.norm(self.tip)), 1e-9)

    @property
    def across_sigma_mm(self) -> float:
        """Standard deviation per axis of the tip across the shaft."""
        return math.hypot(self.noise.translation_mm, self.noise.rotation_rad * self.length_mm)


def fit_linear(poses: PoseStack, noise: PoseNoise) -> PivotFit:
    """Solve ``[R | -1] [tip; pivot] = -t`` by least squares, without rotation noise."""
    count = len(poses.rotations)
    rows = np.concatenate([poses.rotations, np.broadcast_to(-np.eye(3), (count, 3, 3))], axis=2)
    solution = np.linalg.lstsq(rows.reshape(-1, 6), -poses.translations_mm.ravel(), rcond=None)[0]
    return PivotFit(solution[:3], solution[3:], noise)


def whitened(fit: PivotFit, poses: PoseStack) -> FloatArray:
    """Return misfits (n, 3) divided by their standard deviations along and across the shaft.

    Rotation noise of the sensor moves the tip across the shaft in proportion to the shaft's length.
    With this length in the weights the likelihood is that of errors in variables (total least
    squares), which is not biased towards a shorter tip.
    """
    offsets = poses.rotations @ fit.tip
    misfits = offsets + poses.translations_mm - fit.pivot
    directions = offsets / fit.length_mm
    along = np.sum(misfits * directions, axis=1, keepdims=True) * directions
    return np.asarray(along / fit.noise.translation_mm + (misfits - along) / fit.across_sigma_mm)


def maximum_likelihood(poses: PoseStack, start: PivotFit) -> PivotFit:
    """Minimise the squared whitened misfits with the noise of ``start``.

    Raises `ConvergenceError`.
    """

    # Relative to the start: coordinates far from the origin would lose digits.
    def residuals(step: FloatArray) -> FloatArray:
        fit = PivotFit(start.tip + step[:3], start.pivot + step[3:], start.noise)
        return whitened(fit, poses).ravel()

    solution = least_squares(
        residuals,
        np.zeros(6),
        jac="3-point",
        method="lm",
        x_scale="jac",
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    if solution.status <= 0:
        raise ConvergenceError(f"pivot fit did not converge: {solution.message}")
    return PivotFit(start.tip + solution.x[:3], start.pivot + solution.x[3:], start.noise)


def jacobian_of(fit: PivotFit, poses: PoseStack) -> FloatArray:
    """Jacobian (n, 3, 6) of the whitened misfits by the tip and the pivot."""
    directions = poses.rotations @ fit.tip / fit.length_mm
    along = directions[:, :, None] * directions[:, None, :]
    whiten = along / fit.noise.translation_mm + (np.eye(3) - along) / fit.across_sigma_mm
    return np.concatenate([whiten @ poses.rotations, -whiten], axis=2)


def fit_with_noise_estimate(poses: PoseStack, start: PivotFit) -> PivotFit:
    """Estimate tip and noise alternately.

    The misfit along the shaft contains no rotation noise, so it gives the translation noise. Raises
    `ConvergenceError`.
    """
    fit = start
    for _ in range(MAX_NOISE_ROUNDS):
        fit = maximum_likelihood(poses, fit)
        jacobian = jacobian_of(fit, poses)
        flat = jacobian.reshape(-1, 6)
        hat = jacobian @ np.linalg.inv(flat.T @ flat) @ np.swapaxes(jacobian, 1, 2)
        offsets = poses.rotations @ fit.tip
        directions = offsets / fit.length_mm
        misfits = offsets + poses.translations_mm - fit.pivot
        along_hat = np.einsum("ni,nij,nj->n", directions, hat, directions)
        along = np.sum(misfits * directions, axis=1)
        along_freedom = float(np.sum(1.0 - along_hat))
        across_freedom = float(np.sum(2.0 - np.trace(hat, axis1=1, axis2=2) + along_hat))
        along_variance = float(np.sum(along**2)) / along_freedom
        across_variance = float(np.sum(misfits**2) - np.sum(along**2)) / across_freedom
        if across_variance <= along_variance:
            total = along_variance * along_freedom + across_variance * across_freedom
            along_variance = total / (along_freedom + across_freedom)
            across_variance = along_variance
        noise = PoseNoise(
            max(math.sqrt(across_variance - along_variance) / fit.length_mm, NO_ROTATION_NOISE_RAD),
            max(math.sqrt(along_variance), NO_TRANSLATION_NOISE_MM),
        )
        translation_change = abs(math.log(noise.translation_mm / fit.noise.translation_mm))
        rotation_change_mm = abs(noise.rotation_rad - fit.noise.rotation_rad) * fit.length_mm
        fit = PivotFit(fit.tip, fit.pivot, noise)
        if noise.translation_mm <= NO_TRANSLATION_NOISE_MM or (
            translation_change < 1e-5 and rotation_change_mm < 1e-5 * noise.translation_mm
        ):
            return fit
    raise ConvergenceError(
        f"noise of the poses of a pivot did not converge in {MAX_NOISE_ROUNDS} rounds"
    )


SPACINGS_RAD = tuple(math.radians(value) for value in (5.0, 3.5, 2.5, 1.75, 1.25, 0.9, 0.6))
"""Angles between selected poses, widest first. Below the last one, noise of a tracker counts as
rotation."""

EXPECTED_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)
"""Noise of an electromagnetic tracker, for the expected covariance."""


MAX_TIP_SIGMA_MM = 0.25


def select_pivot_poses(poses: Sequence[Transform]) -> tuple[int, ...]:
    """Return indices of poses at the widest spacing that is expected to determine the tip.

    The expected sigma of the tip is to be at most `MAX_TIP_SIGMA_MM`; without such a spacing the
    narrowest is used, and the fit decides. Raises `TooFewError` for fewer than 10 poses even at the
    narrowest spacing.
    """
    selected: tuple[int, ...] = ()
    for spacing in SPACINGS_RAD:
        selected = select_poses(poses, min_distance_mm=0.0, min_angle_rad=spacing)
        if expected_tip_sigma_mm([poses[index] for index in selected]) <= MAX_TIP_SIGMA_MM:
            return selected
    if len(selected) < MIN_POSES:
        turn = max(pose.angle_to(poses[0]) for pose in poses)
        raise TooFewError(
            f"{len(selected)} poses for a pivot, of {len(poses)} samples that turn by at most "
            f"{math.degrees(turn):.3g} degrees from the first; expected at least {MIN_POSES} that "
            f"differ by {math.degrees(SPACINGS_RAD[-1]):g} degrees"
        )
    return selected


def expected_tip_sigma_mm(poses: Sequence[Transform]) -> float:
    """Expected 3-D RMS error of the tip by `EXPECTED_NOISE`; infinite if undetermined."""
    if len(poses) < MIN_POSES:
        return math.inf
    stack = PoseStack(
        poses[0].target,
        poses[0].source,
        np.stack([pose.rotation for pose in poses]),
        np.stack([pose.translation_mm for pose in poses]),
    )
    jacobian = jacobian_of(fit_linear(stack, EXPECTED_NOISE), stack).reshape(-1, 6)
    information = jacobian.T @ jacobian
    if np.linalg.cond(information) > 1e12:
        return math.inf
    return math.sqrt(float(np.trace(np.linalg.inv(information)[:3, :3])))
