"""Pivot calibration: the tip of a tracked tool from poses that rotate about it.

Every ``reference_from_tool[i]`` maps the tip to the same point, the pivot. Plain least squares of
``R_i tip + t_i - pivot`` is biased by rotation noise: it shortens the tip, more for a narrow cone,
and the residual does not show it. Therefore rotation noise is part of the likelihood, and the
uncertainty of the tip, not the residual, decides the acceptance.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, Transform
from app.registration.consensus import find_consensus
from app.registration.input_checks import DegenerateMotionError, check_positive
from app.registration.pivot_fit import (
    MIN_POSES,
    NOMINAL_NOISE,
    PivotFit,
    fit_linear,
    fit_with_noise_estimate,
    jacobian_of,
    maximum_likelihood,
    whitened,
)
from app.registration.pose_stack import PoseNoise, PoseStack, fit_covariance
from app.registration.registration_result import checked_covariance, read_only
from app.registration.spin import tip_transform

MIN_SWING_RAD = math.radians(30.0)
"""Minimum swing for acceptance. Below it the tip along the shaft depends on the assumed noise: in
real recordings of 20 to 30 degrees it varied by up to 8 mm with residuals of 0.2 mm."""

NARROW_SHARE = 0.06
"""That variation as a share of the distance from the sensor to the tip, to which it is
proportional. For a sensor so close to the tip that it is below the permitted sigma, sigma alone
decides."""


@dataclass(frozen=True, slots=True, eq=False)
class PivotResult:
    """The tip (3,) in mm in the tool frame and the pivot (3,) in mm in the reference frame.

    ``covariance`` (6, 6)
        Of tip and pivot, in mm2. For errors that are correlated over time or differ by direction,
        see `app.registration.pose_stack`.
    ``residuals_mm`` (n,)
        Distance of the tip from the pivot in each pose, outliers included.
    ``rms_mm``
        Root mean square of the residuals without outliers. It does not measure the error of the tip
        if the swing is small.
    ``noise``
        Noise of one pose, given or estimated from the residuals along and across the shaft.
    ``condition``
        Condition number of the fit: sigma of the worst over that of the best known direction.
    ``swing_rad``
        Opening angle of the cone that the shaft fills: the largest angle between two of its
        directions, but at most 2.8 times their RMS angle from the mean direction, so that a single
        pose does not widen the cone.

    >>> import numpy as np
    >>> import marginguard as mg
    >>> rng, tip, poses = np.random.default_rng(1), [0.0, 0.0, 120.0], []
    >>> for _ in range(60):  # the tip rests at the tracker's origin
    ...     turn = mg.Transform.from_rotation_vector(
    ...         rng.uniform(-0.6, 0.6, 3), [0, 0, 0], target="tracker", source="stylus"
    ...     )
    ...     noise = rng.normal(0.0, 0.1, 3)
    ...     poses.append(mg.Transform("tracker", "stylus", turn.rotation, noise - turn.apply(tip)))
    >>> result = mg.calibrate_pivot(poses)
    >>> tool_from_tip = result.tool_from_tip("stylus_tip")
    >>> tool_from_tip.target, tool_from_tip.source, round(float(tool_from_tip.translation_mm[2]))
    ('stylus', 'stylus_tip', 120)
    """

    tool_frame: str
    reference_frame: str
    tip_mm: FloatArray
    pivot_mm: FloatArray
    covariance: FloatArray
    residuals_mm: FloatArray
    rms_mm: float
    noise: PoseNoise
    condition: float
    swing_rad: float
    outliers: tuple[int, ...]
    accepted: bool
    reason: str

    def __post_init__(self) -> None:
        for name in ("tip_mm", "pivot_mm", "residuals_mm"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        object.__setattr__(self, "covariance", checked_covariance(self.covariance, 6))

    @property
    def tip_sigma_mm(self) -> float:
        """Expected 3-D root mean square error of the tip."""
        return math.sqrt(float(np.trace(self.covariance[:3, :3])))

    def tool_from_tip(self, tip_frame: str, shaft: FloatArray | None = None) -> Transform:
        """Return the tip's frame as in `tip_transform`.

        ``shaft`` (3,) is from a spin calibration; by default it points from the sensor to the tip.
        """
        return tip_transform(
            self.tip_mm,
            self.tip_mm if shaft is None else shaft,
            tool_frame=self.tool_frame,
            tip_frame=tip_frame,
        )


def calibrate_pivot(
    reference_from_tool: Sequence[Transform],
    *,
    noise: PoseNoise | None = None,
    max_tip_sigma_mm: float = 0.5,
) -> PivotResult:
    """Compute the tip of a tool from n >= 10 poses that rotate about it.

    ``noise`` is that of one pose; by default both its parts are estimated from the residuals. Not
    accepted if sigma of the tip is above ``max_tip_sigma_mm``, or if the swing of the shaft is
    below `MIN_SWING_RAD` and the sensor is not close to the tip (`NARROW_SHARE`). Raises
    `TooFewError`, `FrameError`, `DegenerateMotionError` (one pose repeated, too little rotation,
    one axis only) or `NoConsensusError`.

    >>> import numpy as np
    >>> import marginguard as mg
    >>> rng, tip, poses = np.random.default_rng(1), [0.0, 0.0, 120.0], []
    >>> for _ in range(60):  # the tip rests at the tracker's origin
    ...     turn = mg.Transform.from_rotation_vector(
    ...         rng.uniform(-0.6, 0.6, 3), [0, 0, 0], target="tracker", source="stylus"
    ...     )
    ...     noise = rng.normal(0.0, 0.1, 3)
    ...     poses.append(mg.Transform("tracker", "stylus", turn.rotation, noise - turn.apply(tip)))
    >>> result = mg.calibrate_pivot(poses)
    >>> result.accepted, bool(np.linalg.norm(result.tip_mm - tip) < 0.5)
    (True, True)
    """
    check_positive(max_tip_sigma_mm, "max_tip_sigma_mm")
    poses = PoseStack.from_poses(reference_from_tool, "a pivot", min_count=MIN_POSES)
    _check_rotations(poses)

    def initialise(mask: NDArray[np.bool_]) -> PivotFit:
        return fit_linear(poses.select(mask), noise or NOMINAL_NOISE)

    def refine(mask: NDArray[np.bool_], fit: PivotFit) -> PivotFit:
        used = poses.select(mask)
        return (
            fit_with_noise_estimate(used, fit) if noise is None else maximum_likelihood(used, fit)
        )

    def linearise(fit: PivotFit) -> tuple[FloatArray, FloatArray]:
        return whitened(fit, poses), jacobian_of(fit, poses)

    inliers, fit = find_consensus(
        len(reference_from_tool),
        "poses of a pivot",
        sample_size=5,
        noise_known=noise is not None,
        initialise=initialise,
        refine=refine,
        linearise=linearise,
    )
    used = poses.select(inliers)
    _check_rotations(used)
    return _result(poses, used, inliers, fit, max_tip_sigma_mm)


def _check_rotations(poses: PoseStack) -> None:
    values = np.linalg.svd(poses.relative_rotations("a pivot"), compute_uv=False)
    if values[1] < 0.02 * values[0]:
        raise DegenerateMotionError(
            "the poses of a pivot rotate about one axis only, so the tip is undetermined along it; "
            "expected rotations about two axes"
        )


def _result(
    poses: PoseStack,
    used: PoseStack,
    inliers: NDArray[np.bool_],
    fit: PivotFit,
    max_tip_sigma_mm: float,
) -> PivotResult:
    jacobian = jacobian_of(fit, used)
    covariance = fit_covariance(whitened(fit, used), jacobian, np.flatnonzero(inliers))
    residuals = np.linalg.norm(
        poses.rotations @ fit.tip + poses.translations_mm - fit.pivot, axis=1
    )
    rms = math.sqrt(float(np.mean(residuals[inliers] ** 2)))
    directions = used.rotations @ fit.tip / max(float(np.linalg.norm(fit.tip)), 1e-9)
    swing = _swing(directions)
    sigma = math.sqrt(float(np.trace(covariance[:3, :3])))
    faults = []
    if swing < MIN_SWING_RAD and NARROW_SHARE * fit.length_mm > max_tip_sigma_mm:
        faults.append(
            f"the shaft swings over {math.degrees(swing):.3g} degrees; "
            f"expected at least {math.degrees(MIN_SWING_RAD):g}"
        )
    if sigma > max_tip_sigma_mm:
        faults.append(
            f"sigma of the tip is {sigma:.3g} mm; expected at most {max_tip_sigma_mm:g} mm"
        )
    detail = (
        f"sigma of the tip is {sigma:.3g} mm from {int(inliers.sum())} of {len(inliers)} poses "
        f"over {math.degrees(swing):.3g} degrees"
    )
    return PivotResult(
        tool_frame=poses.source,
        reference_frame=poses.target,
        tip_mm=fit.tip,
        pivot_mm=fit.pivot,
        covariance=covariance,
        residuals_mm=residuals,
        rms_mm=rms,
        noise=fit.noise,
        condition=float(np.linalg.cond(jacobian.reshape(-1, 6))),
        swing_rad=swing,
        outliers=tuple(np.flatnonzero(~inliers).tolist()),
        accepted=not faults,
        reason="; ".join(faults) or detail,
    )


def _swing(directions: FloatArray) -> float:
    """Opening angle in rad of the cone that unit vectors (n, 3) fill (see `PivotResult`)."""
    mean = directions.mean(axis=0)
    cosines = directions @ mean / np.linalg.norm(mean)
    angles = np.arccos(np.clip(cosines, -1.0, 1.0))
    # In a uniformly filled cone of half-angle h the RMS angle from its axis is h / sqrt(2).
    filled = 2.0 * math.sqrt(2.0 * float(np.mean(angles**2)))
    largest = math.acos(float(np.clip(np.min(directions @ directions.T), -1.0, 1.0)))
    return min(filled, largest)
