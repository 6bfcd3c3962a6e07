"""The pose of an arm's base in the tumour's frame, from the tracker and a registration."""

import threading

from marginguard_msgs.msg import TrackedTransform as TrackedTransformMessage

from app.bridge.arm_control.single_sender import SingleSender
from app.bridge.node import RosNode
from app.bridge.qos import INCOMING, Topic
from app.case import values_reader
from app.case.messages.ros_messages import TRACKED_TRANSFORM
from app.control import PoseMeasurement
from app.geometry import MarginGuardError, TrackedTransform, Transform


class BasePose:
    """Follows the tumour's tracked frame, and the frame that the base is registered in.

    ``/tf`` and ``/tf_static`` are not read: any node may write there. ``frame_from_tumor`` and
    ``frame_from_base`` are those of `app.control.ControlDescription`. If the tracker measures the
    tumour in the base's frame, that frame is the tracker's and does not move.
    """

    def __init__(
        self, ros: RosNode, topic: str, frame_from_tumor: Transform, frame_from_base: Transform
    ) -> None:
        self._frame_from_tumor, self._frame_from_base = frame_from_tumor, frame_from_base
        self._used = {frame_from_tumor.target, frame_from_base.target}
        self._samples: dict[str, TrackedTransform] = {}
        self._lock = threading.Lock()
        self._read = values_reader(TRACKED_TRANSFORM)
        self.refused = 0
        """Number of messages that could not be read."""
        self._sender = SingleSender(
            ros, Topic(topic, TrackedTransformMessage, INCOMING), self._take
        )

    def problem(self) -> str:
        """Why no pose may be used; empty if it may."""
        return self._sender.problem()

    def measurement(self) -> PoseMeasurement | None:
        """The base in the tumour's frame, with the stamp of the oldest sample that is used.

        None before the first samples, if the newest one is lost, and while two nodes send poses.
        """
        if self.problem():
            return None
        tumor, base = self._frame_from_tumor.target, self._frame_from_base.target
        with self._lock:
            of_tumor, of_base = self._samples.get(tumor), self._samples.get(base)
        if of_tumor is None or of_tumor.transform is None:
            return None
        tracker_from_tumor = of_tumor.transform @ self._frame_from_tumor
        stamp_ns, tracker_from_base = of_tumor.stamp.ns, self._frame_from_base
        if base != of_tumor.target:
            if of_base is None or of_base.transform is None or of_base.target != of_tumor.target:
                return None
            tracker_from_base = of_base.transform @ self._frame_from_base
            stamp_ns = min(stamp_ns, of_base.stamp.ns)
        return PoseMeasurement(stamp_ns, tracker_from_tumor.inverse() @ tracker_from_base)

    def _take(self, data: bytes) -> None:
        try:
            sample = self._read(data).sample()
        except MarginGuardError:
            self.refused += 1
            return
        if sample.source in self._used:
            with self._lock:
                self._samples[sample.source] = sample
