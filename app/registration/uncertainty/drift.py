"""Whether a registration still holds: the tool where the robot says, against where it is seen.

A base that was bumped, a reference that slipped or metal in the field shows here first.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from app.geometry import Transform
from app.registration.errors import ShapeError
from app.registration.inputs import as_point
from app.registration.poses import PoseNoise
from app.registration.uncertainty.result import RegistrationResult
from app.registration.uncertainty.tre import predict_tre


@dataclass(frozen=True, slots=True)
class DriftBound:
    """Largest difference between predicted and measured pose that is still noise."""

    translation_mm: float
    rotation_rad: float

    @classmethod
    def from_noise(
        cls,
        registration: RegistrationResult,
        tool_mm: ArrayLike,
        noise: PoseNoise,
        *,
        sigmas: float,
    ) -> "DriftBound":
        """``sigmas`` times what is to be expected at ``tool_mm`` (3,) in the reference frame.

        From the covariance of the registration and the noise of one tracked pose; the error of the
        sensor's mount on the tool comes on top. Raises `CovarianceError` for a given registration.
        """
        sigma_mm = float(predict_tre(registration, as_point(tool_mm, "tool_mm")[None])[0])
        covariance = np.asarray(registration.covariance)
        return cls(
            sigmas * math.hypot(sigma_mm, math.sqrt(3.0) * noise.translation_mm),
            sigmas * math.sqrt(float(np.trace(covariance[:3, :3])) + 3.0 * noise.rotation_rad**2),
        )

    def __post_init__(self) -> None:
        for name in ("translation_mm", "rotation_rad"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ShapeError(f"{name} of a drift bound is {value}: above 0 wanted")


@dataclass(frozen=True, slots=True)
class RegistrationDrift:
    """How far apart two poses of ``frame`` are, and what was allowed."""

    frame: str
    translation_mm: float
    rotation_rad: float
    bound: DriftBound

    @property
    def accepted(self) -> bool:
        """Whether both are within the bound."""
        return bool(
            self.translation_mm <= self.bound.translation_mm
            and self.rotation_rad <= self.bound.rotation_rad
        )

    @property
    def reason(self) -> str:
        """The line that says so."""
        return (
            f"{self.frame} is {self.translation_mm:.3g} mm and "
            f"{math.degrees(self.rotation_rad):.3g} degrees from where the registration puts it, "
            f"{self.bound.translation_mm:g} mm and {math.degrees(self.bound.rotation_rad):.3g} "
            "degrees allowed"
        )


def check_drift(predicted: Transform, measured: Transform, bound: DriftBound) -> RegistrationDrift:
    """Compare two poses of one tool in one frame, taken at the same moment.

    ``predicted`` goes by way of the registration (base, kinematics, mount), ``measured`` by the
    tracker. Raises `FrameError` when they are not between the same frames.
    """
    return RegistrationDrift(
        frame=predicted.source,
        translation_mm=predicted.distance_mm_to(measured),
        rotation_rad=predicted.angle_to(measured),
        bound=bound,
    )
