"""The pose of an arm's base in the tumour's frame, from the tracker and the guard's setup."""

import threading
from typing import NamedTuple

from geometry_msgs.msg import TransformStamped
from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.msg import TrackedTransform as TrackedTransformMessage

from app.bridge.arm_control.single_sender import SingleSender
from app.bridge.messages import MM_PER_M
from app.bridge.node import RosNode
from app.bridge.qos import INCOMING, Topic
from app.case import values_reader
from app.case.messages.ros_messages import TRACKED_TRANSFORM
from app.control import PoseMeasurement
from app.geometry import FrameError, MarginGuardError, TrackedTransform, Transform


class Setup(NamedTuple):
    """Poses that a guard publishes with its constraint.

    ``frame_from_tumor`` is the tumour in the tracked frame that it moves with. ``frame_from_base``
    is the registered base of the robot, None without a registration.
    """

    frame_from_tumor: Transform
    frame_from_base: Transform | None


def setup_of(message: FixtureConstraint) -> Setup | None:
    """The poses of ``message``; None if one of them is not valid."""
    try:
        tumor = _transform(message.tumor)
        if tumor.source != message.header.frame_id:
            return None
        return Setup(tumor, _transform(message.base) if message.base.child_frame_id else None)
    except MarginGuardError:
        return None


class BasePose:
    """Follows the tumour's tracked frame, and the frame that the base is registered in.

    ``/tf`` and ``/tf_static`` are not read: any node may write there. The poses are those of the
    guard's `Setup`; ``frame_from_base`` is used where it has no registration. If the tracker
    measures the tumour in the base's frame, that frame is the tracker's and does not move.
    """

    def __init__(self, ros: RosNode, topic: str, frame_from_base: Transform | None) -> None:
        self._frame_from_base = frame_from_base
        self._setup: Setup | None = None
        self._samples: dict[str, TrackedTransform] = {}
        self._lock = threading.Lock()
        self._read = values_reader(TRACKED_TRANSFORM)
        self.refused = 0
        """Number of messages that could not be read."""
        self._sender = SingleSender(
            ros, Topic(topic, TrackedTransformMessage, INCOMING), self._take
        )

    def use(self, setup: Setup | None) -> None:
        """Use the poses of the newest constraint; None allows no pose."""
        base = self._frame_from_base
        if setup is not None and setup.frame_from_base is None:
            setup = None if base is None else setup._replace(frame_from_base=base)
        with self._lock:
            self._setup = setup
            used = self._used()
            self._samples = {name: each for name, each in self._samples.items() if name in used}

    def problem(self) -> str:
        """The problem that forbids the use of the poses; empty without one."""
        return self._sender.problem()

    def measurement(self) -> PoseMeasurement | None:
        """The base in the tumour's frame, with the stamp of the oldest sample that is used.

        None before the first samples, if the newest one is lost, while two nodes send poses, and
        without poses of the guard.
        """
        if self.problem():
            return None
        with self._lock:
            setup = self._setup
            if setup is None or setup.frame_from_base is None:
                return None
            tumor, base = setup.frame_from_tumor.target, setup.frame_from_base.target
            of_tumor, of_base = self._samples.get(tumor), self._samples.get(base)
        if of_tumor is None or of_tumor.transform is None:
            return None
        tracker_from_tumor = of_tumor.transform @ setup.frame_from_tumor
        stamp_ns, tracker_from_base = of_tumor.stamp.ns, setup.frame_from_base
        if base != of_tumor.target:
            if of_base is None or of_base.transform is None or of_base.target != of_tumor.target:
                return None
            tracker_from_base = of_base.transform @ setup.frame_from_base
            stamp_ns = min(stamp_ns, of_base.stamp.ns)
        return PoseMeasurement(stamp_ns, tracker_from_tumor.inverse() @ tracker_from_base)

    def _used(self) -> set[str]:
        """Frames of the tracker that are needed."""
        edges = () if self._setup is None else self._setup
        return {edge.target for edge in edges if edge is not None}

    def _take(self, data: bytes) -> None:
        try:
            sample = self._read(data).sample()
        except MarginGuardError:
            self.refused += 1
            return
        with self._lock:
            if sample.source in self._used():
                self._samples[sample.source] = sample


def _transform(message: TransformStamped) -> Transform:
    """Raises `MarginGuardError` for numbers that are no pose and without names."""
    if not (message.header.frame_id and message.child_frame_id):
        raise FrameError("pose of a constraint: has no frames; expected their names")
    place, turn = message.transform.translation, message.transform.rotation
    return Transform.from_quaternion(
        (turn.x, turn.y, turn.z, turn.w),
        [MM_PER_M * value for value in (place.x, place.y, place.z)],
        target=message.header.frame_id,
        source=message.child_frame_id,
    )
