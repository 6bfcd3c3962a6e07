"""Inputs of the controller of an arm: joints, the hand's wrench, the base's pose, constraints."""

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import TransformStamped, WrenchStamped
from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.msg import TrackedTransform as TrackedTransformMessage
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from app.bridge.constraint_message import plain_constraint, split_at_seq
from app.bridge.message_origin import Origin
from app.bridge.messages import ns_of, placed
from app.bridge.node import RosNode
from app.bridge.ros_errors import BridgeError
from app.bridge.sender_names import MAX_BYTES, SingleSender
from app.bridge.topics import INCOMING, POLLED, Topic
from app.case import message_decoder
from app.case.messages.ros_messages import JOINT_STATE, TRACKED_TRANSFORM
from app.control import JointMeasurement, PoseMeasurement, WrenchMeasurement
from app.fixture import PlainConstraint
from app.geometry import (
    FrameError,
    MarginGuardError,
    TrackedTransform,
    Transform,
)

_TIMEOUT_S = 5.0
_POLL_S = 0.01

_MAX_SENDERS = 8


class NewestMessage:
    """The newest message of the topic ``name`` of one sender, taken when it is asked for.

    Thread-safe. Only the newest message is deserialised.
    """

    def __init__(
        self, ros: RosNode, name: str, kind: type, read: Callable[[bytes], Any] | None = None
    ) -> None:
        """``read(data)`` gives the message, by default as rclpy does."""
        self._read = read or partial(deserialize_message, message_type=kind)
        self._lock = threading.Lock()
        self._data: bytes | None = None
        self._message: Any = None
        self.refused = 0
        """Number of messages that could not be read."""
        self._sender = SingleSender(ros, Topic(name, kind, INCOMING), self._take, polled=True)

    def problem(self) -> str:
        """The problem that forbids the use of the messages; empty without one."""
        return self._sender.problem()

    def message(self) -> Any:
        """The newest message; None before the first, after an invalid one and for two senders."""
        self._sender.poll()
        if self.problem():
            return None
        with self._lock:
            data, self._data = self._data, None
        if data is not None:
            try:
                self._message = self._read(data)
            except Exception:  # rclpy raises several unrelated types for invalid bytes
                self._message = None
                self.refused += 1
        return self._message

    def _take(self, data: bytes) -> None:
        with self._lock:
            self._data = data


class JointInput(NewestMessage):
    """Joints of ``arm``."""

    def __init__(self, ros: RosNode, arm: str) -> None:
        super().__init__(ros, f"{arm}/measured_js", JointState, message_decoder(JOINT_STATE))

    def measurement(self) -> JointMeasurement | None:
        """The newest joint positions, with the stamp of their message."""
        found = self.message()
        return None if found is None else JointMeasurement(found.ns, found.names, found.positions)


def read_joints(arm: str) -> dict[str, float]:
    """The joint positions of ``arm`` now. Call `app.bridge.prepare_environment` before.

    Raises `BridgeError` if none arrive in 5 s, or with names for others.
    """
    with RosNode("joint_reader") as ros:
        joints, end_s = JointInput(ros, arm), time.monotonic() + _TIMEOUT_S
        while (found := joints.measurement()) is None:
            if time.monotonic() > end_s:
                problem = joints.problem() or f"{arm}/measured_js: no message in {_TIMEOUT_S:g} s"
                raise BridgeError(f"{problem}; expected the joint positions of a running arm")
            time.sleep(_POLL_S)
    if len(found.names) != len(found.positions):
        raise BridgeError(
            f"{arm}/measured_js: has {len(found.names)} names and {len(found.positions)} "
            "positions; expected as many positions as names"
        )
    return dict(zip(found.names, found.positions, strict=True))


class WrenchInput(NewestMessage):
    """The hand's wrench on ``topic``, in the axes of the tool if ``in_tool``."""

    def __init__(self, ros: RosNode, topic: str, *, in_tool: bool) -> None:
        super().__init__(ros, topic, WrenchStamped)
        self._in_tool = in_tool

    def measurement(self) -> WrenchMeasurement | None:
        """The newest wrench, with the stamp of its message."""
        message = self.message()
        if message is None:
            return None
        force, torque = message.wrench.force, message.wrench.torque
        return WrenchMeasurement(
            ns_of(message.header.stamp),
            np.array([force.x, force.y, force.z]),
            np.array([torque.x, torque.y, torque.z]),
            self._in_tool,
        )


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
        self._read = message_decoder(TRACKED_TRANSFORM)
        self.refused = 0
        """Number of messages that could not be read."""
        self._sender = SingleSender(
            ros, Topic(topic, TrackedTransformMessage, INCOMING), self._take, polled=True
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
        self._sender.poll()
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
    edge = message.transform
    return placed(edge.translation, edge.rotation, message.header.frame_id, message.child_frame_id)


class _Read(NamedTuple):
    """The last constraint that was read, with its bytes ``around`` the seq."""

    around: tuple[bytes, bytes]
    constraint: PlainConstraint
    setup: Setup | None


class ConstraintInput:
    """Receives the topic ``name``. A second guard is not filtered: the rule has to see it."""

    def __init__(self, ros: RosNode, name: str) -> None:
        self._lock = threading.Lock()
        self._waiting: OrderedDict[bytes | None, bytes] = OrderedDict()
        self._last: _Read | None = None
        self.refused = 0
        """Number of messages that could not be read."""
        topic = Topic(name, FixtureConstraint, POLLED)
        self._ros = ros
        self._subscription = ros.subscribe_with_origin(topic, self._take, polled=True)

    def arrived(self) -> list[tuple[PlainConstraint, Setup | None]]:
        """The newest constraint of each sender that has sent since the last call, with its poses.

        The poses are None if they are not valid.
        """
        self._ros.poll(self._subscription)
        with self._lock:
            waiting, self._waiting = self._waiting, OrderedDict()
        found = []
        for data in waiting.values():
            try:
                found.append(self._read(data))
            except Exception:  # rclpy raises several unrelated types for invalid bytes
                self.refused += 1
        return found

    def _read(self, data: bytes) -> tuple[PlainConstraint, Setup | None]:
        """The values of ``data``. A guard repeats its constraint with another seq."""
        before, seq, after = split_at_seq(data)
        last = self._last
        if last is not None and last.around == (before, after):
            return last.constraint.repeated(seq), last.setup
        message = deserialize_message(data, FixtureConstraint)
        constraint, setup = plain_constraint(message), setup_of(message)
        self._last = _Read((before, after), constraint, setup)
        return constraint, setup

    def _take(self, data: bytes, origin: Origin) -> None:
        if len(data) > MAX_BYTES:
            self.refused += 1
            return
        with self._lock:
            self._waiting[origin.sender] = data
            self._waiting.move_to_end(origin.sender)
            while len(self._waiting) > _MAX_SENDERS:
                self._waiting.popitem(last=False)
