"""Pivot calibration: where the tip of a tracked tool is, from poses that turn about it.

``reference_from_tool[i]`` maps the tip to one and the same point, the pivot. Least squares of
``R_i tip + t_i - pivot`` shortens the tip when the rotations are noisy, more so the narrower the
cone, and its residual does not show it. So rotation noise is part of the likelihood here, and what
a pivot is accepted by is the uncertainty of the tip, not the residual.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, Transform
from app.registration.consensus import agreeing
from app.registration.errors import DegenerateMotionError, ShapeError
from app.registration.poses import PoseNoise, PoseStack
from app.registration.tool.pivot_fit import (
    NOMINAL_NOISE,
    PivotFit,
    jacobian_of,
    linear,
    maximum_likelihood,
    whitened,
    with_estimated_noise,
)
from app.registration.tool.tip_frame import tip_transform
from app.registration.uncertainty.result import checked_covariance, read_only

MIN_POSES = 10

MIN_TURN_RAD = math.radians(15.0)
"""Below this nothing can be said of the tip, and nothing is."""

MIN_SWING_RAD = math.radians(30.0)
"""Below this the tip along the shaft hangs on the noise being what it is thought to be: real
dwells of 20 to 30 degrees put it up to 8 mm apart with residuals of 0.2 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class PivotResult:
    """The tip (3,) in mm in the tool frame, the pivot (3,) in mm in the reference frame.

    ``covariance`` (6, 6)
        Of tip and pivot, mm2.
    ``residuals_mm`` (n,)
        Distance of the tip from the pivot in each pose, dropped poses included.
    ``rms_mm``
        Root mean square of the used residuals; says nothing of the tip when the swing is small.
    ``noise``
        Of one pose: handed in, or estimated from the residuals along and across the shaft.
    ``condition``
        Condition number of the fit: by how much worse the worst direction is known than the best.
    ``swing_rad``
        Opening of the cone that the shaft filled: largest angle between two of its directions, or
        2.8 times their RMS angle from the middle where that is less, so that one pose makes no
        cone.
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
        """3-D root mean square error of the tip that is to be expected."""
        return math.sqrt(float(np.trace(self.covariance[:3, :3])))

    def tool_from_tip(self, tip_frame: str, shaft: FloatArray | None = None) -> Transform:
        """The tip's frame as `tip_transform` has it; the shaft from the sensor to the tip unless a
        spin found a better one.
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
    """The tip of a tool from n >= 10 poses that turn about it.

    ``noise`` of one pose; without it both parts are estimated from the residuals. Not accepted
    when the shaft swings over less than `MIN_SWING_RAD`, or when ``max_tip_sigma_mm`` is below the
    sigma of the tip. Raises `TooFewError`, `FrameError`, `DegenerateMotionError` (one pose
    repeated, hardly any turn, one axis only) or `NoConsensusError`.
    """
    if not (math.isfinite(max_tip_sigma_mm) and max_tip_sigma_mm > 0.0):
        raise ShapeError(f"max_tip_sigma_mm is {max_tip_sigma_mm}: above 0 wanted")
    poses = PoseStack.of(reference_from_tool, "a pivot", least=MIN_POSES)
    _check_turn(poses)

    def start(mask: NDArray[np.bool_]) -> PivotFit:
        return linear(poses.of_poses(mask), noise or NOMINAL_NOISE)

    def refine(mask: NDArray[np.bool_], fit: PivotFit) -> PivotFit:
        used = poses.of_poses(mask)
        return with_estimated_noise(used, fit) if noise is None else maximum_likelihood(used, fit)

    def linearise(fit: PivotFit) -> tuple[FloatArray, FloatArray]:
        return whitened(fit, poses), jacobian_of(fit, poses)

    good, fit = agreeing(
        len(reference_from_tool),
        "poses of a pivot",
        draw=5,
        noise_known=noise is not None,
        start=start,
        refine=refine,
        linearise=linearise,
    )
    used = poses.of_poses(good)
    _check_turn(used)
    return _result(poses, used, good, fit, max_tip_sigma_mm)


def _check_turn(poses: PoseStack) -> None:
    turns = poses.relative_turns()
    largest = float(np.linalg.norm(turns, axis=1).max())
    if largest < MIN_TURN_RAD:
        raise DegenerateMotionError(
            f"the poses of a pivot turn by {math.degrees(largest):.3g} degrees at most: "
            f"{math.degrees(MIN_TURN_RAD):g} wanted"
        )
    values = np.linalg.svd(turns, compute_uv=False)
    if values[1] < 0.02 * values[0]:
        raise DegenerateMotionError(
            "the poses of a pivot turn about one axis only: the tip may be anywhere along it"
        )


def _result(
    poses: PoseStack,
    used: PoseStack,
    good: NDArray[np.bool_],
    fit: PivotFit,
    max_tip_sigma_mm: float,
) -> PivotResult:
    jacobian = jacobian_of(fit, used).reshape(-1, 6)
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    residuals = np.linalg.norm(
        poses.rotations @ fit.tip + poses.translations_mm - fit.pivot, axis=1
    )
    rms = math.sqrt(float(np.mean(residuals[good] ** 2)))
    directions = used.rotations @ fit.tip / max(float(np.linalg.norm(fit.tip)), 1e-9)
    swing = _swing(directions)
    sigma = math.sqrt(float(np.trace(covariance[:3, :3])))
    faults = []
    if swing < MIN_SWING_RAD:
        faults.append(
            f"the shaft swings over {math.degrees(swing):.3g} degrees, "
            f"{math.degrees(MIN_SWING_RAD):g} wanted"
        )
    if sigma > max_tip_sigma_mm:
        faults.append(f"sigma of the tip is {sigma:.3g} mm, {max_tip_sigma_mm:g} mm allowed")
    finding = (
        f"sigma of the tip is {sigma:.3g} mm from {int(good.sum())} of {len(good)} poses "
        f"over {math.degrees(swing):.3g} degrees"
    )
    return PivotResult(
        tool_frame=poses.source,
        reference_frame=poses.target,
        tip_mm=fit.tip,
        pivot_mm=fit.pivot,
        covariance=np.asarray(covariance),
        residuals_mm=residuals,
        rms_mm=rms,
        noise=fit.noise,
        condition=float(np.linalg.cond(jacobian)),
        swing_rad=swing,
        outliers=tuple(np.flatnonzero(~good).tolist()),
        accepted=not faults,
        reason="; ".join(faults) or finding,
    )


def _swing(directions: FloatArray) -> float:
    middle = directions.mean(axis=0)
    cosines = directions @ middle / np.linalg.norm(middle)
    from_middle = np.arccos(np.clip(cosines, -1.0, 1.0))
    # An evenly filled cone of half-angle h has directions h / sqrt(2) RMS from its middle.
    filled = 2.0 * math.sqrt(2.0 * float(np.mean(from_middle**2)))
    largest = math.acos(float(np.clip(np.min(directions @ directions.T), -1.0, 1.0)))
    return min(filled, largest)
