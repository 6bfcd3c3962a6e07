"""Motion of all sensors of a session: removes the poses that a sensor cannot have reached."""

from collections.abc import Set as AbstractSet
from dataclasses import replace

from app.case import TrackingFrame
from app.geometry import Edge, Stamp, TrackedTransform
from app.session.plausibility.limits import MotionLimits
from app.session.plausibility.sensor_motion import SensorMotion
from app.session.pose_tree import is_too_far


class MotionCheck:
    """One `SensorMotion` per measured edge. Samples of other edges pass unchecked."""

    def __init__(self, limits: MotionLimits) -> None:
        self._limits = limits
        self._sensors: dict[Edge, SensorMotion] = {}
        self._newest_ns: dict[Edge, int] = {}
        self._now: Stamp | None = None

    def use(self, limits: MotionLimits) -> None:
        """Replace the limits; what is known of the sensors is kept."""
        self._limits = limits
        for sensor in self._sensors.values():
            sensor.limits = limits

    def remove_implausible(self, frame: TrackingFrame, edges: AbstractSet[Edge]) -> TrackingFrame:
        """``frame`` without the samples of ``edges`` that must not be used."""
        if self._now is not None and frame.stamp < self._now:
            self._newest_ns.clear()
            for sensor in self._sensors.values():
                sensor.restart()
        self._now = frame.stamp
        refused = [
            sample
            for sample in frame.poses
            if (sample.target, sample.source) in edges and not self._is_usable(sample, frame.stamp)
        ]
        if not refused:
            return frame
        return replace(
            frame, poses=tuple(sample for sample in frame.poses if sample not in refused)
        )

    def refused(self, edges: AbstractSet[Edge]) -> dict[str, str]:
        """The sensors of ``edges`` that are not believed now: one line each, by name."""
        found = {}
        for edge, sensor in self._sensors.items():
            if sensor.jump is not None and edge in edges:
                name = f"{edge[0]} -> {edge[1]}"
                found[name] = f"{name} {sensor.jump.text}"
        return found

    def _is_usable(self, sample: TrackedTransform, now: Stamp) -> bool:
        edge = (sample.target, sample.source)
        ns, newest_ns = sample.stamp.ns, self._newest_ns.get(edge)
        # As in `PoseTree`: a sample that comes late is not used, and one from the future is now.
        if newest_ns is not None and ns < newest_ns <= now.ns:
            return True
        self._newest_ns[edge] = ns
        pose = sample.transform
        # Drivers send large numbers for a missing pose.
        if pose is None or is_too_far(pose):
            return True
        sensor = self._sensors.get(edge)
        if sensor is None:
            sensor = self._sensors[edge] = SensorMotion(self._limits)
        return sensor.update(pose, min(ns, now.ns))
