"""Errors of a tracker that its samples do not show: their latency, and errors of their poses."""

import math
from dataclasses import dataclass, replace

import numpy as np

from app.case import TrackingFrame
from app.fixture import Proximity
from app.geometry import FloatArray, InputError, TrackedTransform, Transform


@dataclass(frozen=True, slots=True)
class TrackingError:
    """Errors of a tracker as its user knows them, from a data sheet or a measurement.

    ``latency_ns``: from the acquisition of a pose to its stamp, which a driver that stamps on
    arrival hides. ``sigma_mm`` and ``sigma_rad``: standard deviation of a pose along and about each
    axis, of errors that stay for seconds, too. Raises `InputError` for values below 0.

    >>> TrackingError(sigma_mm=0.3).sigma_between(0.0, 0.0)
    0.4242640687119285
    """

    latency_ns: int = 0
    sigma_mm: float = 0.0
    sigma_rad: float = 0.0

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} of the tracker is {value}; expected 0 or more")

    def acquired(self, frame: TrackingFrame) -> TrackingFrame:
        """``frame`` with the acquisition of each pose as its stamp.

        The age of a pose is then its true one: in the margin ``v_max_mm_s`` times the age, in the
        limit for stale poses and in the prediction of the tumour's motion. A stamp after the
        frame's stays as it is, because it is wrong and has to be found.
        """
        if not self.latency_ns:
            return frame
        return TrackingFrame(
            frame.stamp,
            tuple(self._acquired(each, frame) for each in frame.poses),
            frame.joints,
            cautery=frame.cautery,
        )

    def _acquired(self, sample: TrackedTransform, frame: TrackingFrame) -> TrackedTransform:
        if sample.stamp.ns > frame.stamp.ns:
            return sample
        return replace(sample, stamp=sample.stamp.shifted(-self.latency_ns, sample.stamp.clock))

    def sigma_between(self, tool_lever_mm: float, tumor_lever_mm: float) -> float:
        """Standard deviation in mm, along any axis, of a tool point beside a tumour point.

        The points are that far from the origins of the measured frames of tool and tumour. A pose
        that is wrong by the translation t and the rotation vector r moves a point at p by t + r x
        p; for independent errors along and about the axes its variance along an axis is at most
        ``sigma_mm**2 + sigma_rad**2 |p|**2`` (the propagation of a marker frame's error to the
        tip: West and Maurer, Designing Optically Tracked Instruments for Image-Guided Surgery,
        IEEE TMI 23, 2004). The errors of tool and tumour are independent, so variances add up.
        """
        return math.sqrt(
            2.0 * self.sigma_mm**2 + self.sigma_rad**2 * (tool_lever_mm**2 + tumor_lever_mm**2)
        )

    def sigma_of(
        self, proximity: Proximity, tumor_from_tool: Transform, tumor_from_frame: Transform
    ) -> float:
        """`sigma_between` at the witness of ``proximity`` where it is largest, in mm.

        ``tumor_from_tool`` and ``tumor_from_frame`` are the measured frames of tool and tumour in
        the tumour's.
        """
        if not (self.sigma_mm or self.sigma_rad):
            return 0.0
        points = proximity.witnesses.on_tool_mm
        return self.sigma_between(
            _lever_mm(points, tumor_from_tool), _lever_mm(points, tumor_from_frame)
        )


NO_ERROR = TrackingError()
"""Errors of a tracker about which nothing is known: the margin has no term for them."""


def _lever_mm(points: FloatArray, frame: Transform) -> float:
    """Largest distance of ``points`` (k, 3) from the origin of ``frame``."""
    return float(np.linalg.norm(points - frame.translation_mm, axis=1).max())
