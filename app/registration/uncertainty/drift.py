"""Drift of a registration: the tool's pose by the robot compared with its tracked pose.

Detects a robot base that was moved, a reference sensor that slipped, and metal in the EM field.
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
    """Largest difference between predicted and measured pose that counts as noise."""

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
        """Return ``sigmas`` times the expected difference at ``tool_mm`` (3,), reference frame.

        Includes the covariance of the registration and the noise of one tracked pose, but not the
        error of the sensor's mount on the tool. Raises `CovarianceError` for a registration without
        a covariance.
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
                raise ShapeError(
                    f"{name} of a drift bound is {value}; expected a finite number above 0"
                )


@dataclass(frozen=True, slots=True)
class RegistrationDrift:
    """Difference between two poses of ``frame``, and its bound."""

    frame: str
    translation_mm: float
    rotation_rad: float
    bound: DriftBound

    @property
    def accepted(self) -> bool:
        """True if translation and rotation are within the bound."""
        return bool(
            self.translation_mm <= self.bound.translation_mm
            and self.rotation_rad <= self.bound.rotation_rad
        )

    @property
    def reason(self) -> str:
        """One line that describes the difference and the bound."""
        return (
            f"{self.frame} is {self.translation_mm:.3g} mm and "
            f"{math.degrees(self.rotation_rad):.3g} degrees from its pose by the registration; "
            f"expected at most {self.bound.translation_mm:g} mm and "
            f"{math.degrees(self.bound.rotation_rad):.3g} degrees"
        )


def check_drift(predicted: Transform, measured: Transform, bound: DriftBound) -> RegistrationDrift:
    """Compare two poses of one tool in one frame at the same time.

    ``predicted`` is computed from registration, kinematics and mount, ``measured`` by the tracker.
    Raises `FrameError` if their frames differ.
    """
    return RegistrationDrift(
        frame=predicted.source,
        translation_mm=predicted.distance_mm_to(measured),
        rotation_rad=predicted.angle_to(measured),
        bound=bound,
    )
