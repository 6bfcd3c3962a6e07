"""Velocity of the tumour from its measured poses."""

from app.fixture import TumorMotionFilter, TumorMotionParameters
from app.geometry import (
    FloatArray,
    Freshness,
    FreshnessLimits,
    Stamp,
    Transform,
    freshness_of_stamp,
)
from app.session.pose_tree import MeasuredPose


class TumorVelocity:
    """Feeds the tumour's poses to a `TumorMotionFilter`, step by step.

    ``frame_from_tumor`` is the tumour in the tracked frame that it moves with.
    """

    def __init__(self, parameters: TumorMotionParameters, frame_from_tumor: Transform) -> None:
        self._parameters = parameters
        self._frame_from_tumor = frame_from_tumor
        self._filter = TumorMotionFilter(parameters)
        self._now: Stamp | None = None
        self._newest: Stamp | None = None

    def twist(
        self, reference_from_frame: MeasuredPose, now: Stamp, limits: FreshnessLimits
    ) -> FloatArray | None:
        """Twist (6,) of the tumour at ``now`` in mm/s and rad/s, along its own axes.

        None if no sample that the filter accepted is fresh; the tumour then counts as still. The
        filter is reset when ``now`` goes back.
        """
        if self._now is not None and now < self._now:
            self._filter, self._newest = TumorMotionFilter(self._parameters), None
        self._now = now
        pose, stamp = reference_from_frame.transform, reference_from_frame.oldest
        # `MeasuredPose.transform` is None for a stale, lost or future pose.
        if (
            pose is not None
            and stamp is not None
            and (self._newest is None or self._newest < stamp)
        ):
            self._newest = stamp
            self._filter.update(pose @ self._frame_from_tumor, stamp)
        motion = self._filter.at(now)
        if motion is None or freshness_of_stamp(motion.stamp, now, limits) is not Freshness.VALID:
            return None
        return motion.twist
