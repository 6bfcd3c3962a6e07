"""Detect second senders of what a live session measures and publishes."""

import struct
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

from rclpy.publisher import Publisher
from rclpy.timer import Timer

from app.bridge import topics
from app.bridge.live.sources import CountedSubscription
from app.bridge.message_definitions import UNKNOWN_NODE
from app.bridge.message_origin import Origin, sender_of
from app.bridge.node import RosNode
from app.bridge.sender_names import SenderNames, node_name, nodes_text
from app.bridge.topics import INCOMING, STATIC_TF
from app.case.messages.message_values import JointValues, PoseValues
from app.case.messages.ros_messages import TF_MESSAGE
from app.fixture import FIXTURE_FRAME, Reason
from app.geometry import MarginGuardError, Transform
from app.geometry.frames import is_frame
from app.session import (
    SILENT_NS,
    FrameSenders,
    Sample,
    SenderConflict,
    SenderTrail,
    SequenceTrail,
    has_ended,
)
from app.session.live_frames import MAX_NAME_CHARS

MAX_DISTANCE_MM = 0.01
MAX_ANGLE_RAD = 1e-4
"""Largest difference of a transform that repeats one of the session."""

MAX_EDGES = 256
"""Transforms of other nodes that are remembered, besides those of the session's own frames."""

CHECK_S = 0.1
"""Period in which ended faults and bag players are looked for."""

_CONTENT = struct.Struct("<7dB")
_NO_PROBLEM: Mapping[Reason, str] = MappingProxyType({})


class _Foreign(NamedTuple):
    """Latest transform of a child frame by another sender; ``latched`` if it is static."""

    parent: str
    transform: Transform | None
    latched: bool
    heard_ns: int


class StaticWatch:
    """Compares the transforms that other nodes publish with the session's own static ones.

    Another node contradicts the session if it places one of the session's static frames elsewhere
    (another parent or another pose), on ``/tf_static`` or ``/tf``, or if it gives a measured frame
    a static transform. A static one is valid as long as its publisher exists: it is remembered also
    while it repeats the session's own, which another registration may change. The session never
    uses such a transform, but every other node on the graph may do so. Not thread-safe; times are
    monotonic.
    """

    def __init__(self, moving: SenderNames, static: SenderNames) -> None:
        self._names = {False: moving, True: static}
        self._foreign: dict[tuple[bytes | None, str], _Foreign] = {}

    def observe(
        self,
        pose: PoseValues,
        origin: Origin,
        own: Mapping[str, Transform],
        now_ns: int,
        *,
        latched: bool,
    ) -> bool:
        """Process a transform; True if it contradicts ``own`` (static transforms by child)."""
        sender, child = origin.sender, pose.source
        if self._names[latched].is_own(sender) or not (latched or child in own):
            return False
        key = (sender, child)
        if child not in own and key not in self._foreign and len(self._foreign) >= MAX_EDGES:
            return False
        try:
            transform = pose.sample().transform
        except MarginGuardError:  # names that cannot be frames; the reader counts them
            return False
        self._foreign[key] = _Foreign(pose.target, transform, latched, now_ns)
        return _contradicts(self._foreign[key], own.get(child))

    def problems(
        self, own: Mapping[str, Transform], measured: Collection[str], now_ns: int
    ) -> Iterator[str]:
        """One line for each contradiction to ``own`` or to the ``measured`` child frames."""
        for (sender, child), found in self._foreign.items():
            if _contradicts(found, own.get(child)) or (child in measured and child not in own):
                names = self._names[found.latched]
                expected = (
                    f"{own[child].target} -> {child} of this session alone"
                    if child in own
                    else "no static transform of a measured frame"
                )
                yield (
                    f"second sender of {found.parent} -> {child} on {names.topic}, "
                    f"{names.text([sender])}: it contradicts the session; expected {expected}"
                )

    def remove_ended(self, own: Mapping[str, Transform], now_ns: int) -> bool:
        """Remove the transforms whose sender has ended; True if one contradicts ``own``."""
        ended = {
            key: found
            for key, found in self._foreign.items()
            if self._has_ended(key[0], found, now_ns)
        }
        for key in ended:
            del self._foreign[key]
        return any(_contradicts(found, own.get(child)) for (_, child), found in ended.items())

    def _has_ended(self, sender: bytes | None, found: _Foreign, now_ns: int) -> bool:
        is_present = self._names[found.latched].is_present
        if found.latched:  # silent by nature
            return now_ns - found.heard_ns >= SILENT_NS and not is_present(sender)
        return has_ended(sender, found.heard_ns, now_ns, is_present)


def _contradicts(found: _Foreign, own: Transform | None) -> bool:
    """True if ``own``, the session's transform of that frame, exists and is another one."""
    if own is None:
        return False
    transform = found.transform
    if transform is None or found.parent != own.target:
        return True
    repeats = (
        transform.distance_mm_to(own) <= MAX_DISTANCE_MM
        and transform.angle_to(own) <= MAX_ANGLE_RAD
    )
    return not repeats


class SenderWatch:
    """Finds frames, joints, static transforms and constraints that other nodes send as well.

    Call `start` when the session exists, and before its first sample. From then on `accepts_pose`
    and `accepts_joints` process each received sample in the node's thread, `take_tf` the messages
    of tf. `outside` returns the faults for the session's next step.
    ``pose_topic``: where the session's poses arrive, None for a source that is not on the graph.
    ``joint_topic``: the robot's, None without; ``joint_names``: those that move its tool.
    ``edges``: those that the configuration names.
    ``constraint`` is the session's publisher; every other publisher on its topic is a fault.
    ``own`` are all publishers of this node; ``restore_static()`` publishes the session's static
    transforms again. ``find_players()`` looks for bag players on the graph: it is called in the
    node's thread every `CHECK_S`, and before the first sample of each sender is used.

    A name of a node is what the node announces: it is a candidate and not an identity.

    Every guard on the graph publishes `FIXTURE_FRAME`, which no session uses: several senders of it
    are logged and counted, and are no fault.
    """

    def __init__(
        self,
        ros: RosNode,
        pose_topic: str | None,
        joint_topic: str | None,
        joint_names: frozenset[str],
        edges: Collection[tuple[str, str]] = (),
        *,
        constraint: Publisher,
        own: Sequence[Publisher],
        restore_static: Callable[[], None],
        find_players: Callable[[], None],
    ) -> None:
        self._ros = ros
        self._restore_static = restore_static
        self._find_players = find_players
        senders = [sender_of(publisher) for publisher in own]
        self._tf = SenderNames(ros, topics.TF.name, senders)
        self._tf_static = SenderNames(ros, topics.TF_STATIC.name, senders)
        self._poses = self._tf
        if pose_topic not in (None, topics.TF.name):
            self._poses = SenderNames(ros, str(pose_topic), senders)
        self._joints = SenderNames(ros, joint_topic or "", senders)
        self._joint_names = joint_names
        self._constraint = constraint
        self._own_constraint = sender_of(constraint)
        self._names = list(dict.fromkeys([self._tf, self._tf_static, self._poses]))
        if joint_topic is not None:
            self._names.append(self._joints)
        self._frames = FrameSenders(edges)
        self._published = FrameSenders()
        self._static = StaticWatch(self._tf, self._tf_static)
        self._joint_trail, self._joint_sequences = SenderTrail(), SequenceTrail()
        self._seen: dict[bytes, None] = {}
        self._texts: tuple[str, ...] = ()
        self._fixture_text = ""
        self._refused = self._other_fixtures = 0
        self._timer: Timer | None = None

    def start(
        self,
        *,
        edges: Callable[[], Collection[tuple[str, str]]],
        static_edges: Callable[[], Sequence[Transform]],
        fresh_ns: Callable[[], int],
        moving: bool,
    ) -> None:
        """Read the graph for a session, and ``/tf_static``; with ``moving`` also ``/tf``.

        ``edges`` and ``static_edges`` return the session's present measured edges and static
        transforms without waiting for a step, ``fresh_ns`` the time in ns for which a sample is in
        use.
        """
        self._edges, self._static_edges, self._fresh_ns = edges, static_edges, fresh_ns
        self._find_players()
        self._timer = self._ros.every(CHECK_S, self._read_graph)
        static = replace(topics.TF_STATIC, qos=STATIC_TF)
        CountedSubscription(self._ros, static, TF_MESSAGE, partial(self.take_tf, latched=True))
        if moving:
            tf = replace(topics.TF, qos=INCOMING)
            CountedSubscription(self._ros, tf, TF_MESSAGE, partial(self.take_tf, latched=False))

    def outside(self) -> Mapping[Reason, str]:
        """The fault of second senders with a text; empty if there is none. Thread-safe."""
        texts = (*self._texts, *self._foreign_constraints())
        return {Reason.SECOND_SENDER: "; ".join(texts)} if texts else _NO_PROBLEM

    def accepts_pose(self, pose: PoseValues, origin: Origin) -> bool:
        """Process a sample of the pose topic; False if it must not be used."""
        self._meet(self._poses, origin)
        if self._poses is self._tf and pose.source.startswith(FIXTURE_FRAME):
            return False  # computed by a guard, not measured
        is_accepted = self._follow(self._frames, pose, origin)
        if not is_accepted:
            self._refused += 1
        conflicts = not self._texts and self._frames.has_conflict(pose.source)
        if conflicts and any(pose.source == child for _, child in self._edges()):
            self._check()
        return is_accepted

    def accepts_joints(self, joints: JointValues, origin: Origin) -> bool:
        """Process joint positions; False if they must not be used."""
        self._meet(self._joints, origin)
        if self._joint_names.isdisjoint(joints.names):
            return True  # of another device
        sample, now_ns = Sample(joints.ns, (joints.names, joints.positions)), time.monotonic_ns()
        if origin.sender is None:
            if origin.sequence is not None:
                self._joint_sequences.observe(origin.sequence, sample, now_ns)
            is_accepted = True
        else:
            fresh_ns = self._fresh_ns()
            is_accepted = self._joint_trail.observe(origin.sender, sample, now_ns, fresh_ns)
        if not is_accepted:
            self._refused += 1
        has_conflict = self._joint_trail.conflict or self._joint_sequences.check(now_ns)
        if has_conflict and not self._texts:
            self._check()
        return is_accepted

    def take_tf(self, poses: Sequence[PoseValues], origin: Origin, *, latched: bool) -> None:
        """Process a message of ``/tf``, or of ``/tf_static`` with ``latched``."""
        own, now_ns = self._own_static(), time.monotonic_ns()
        contradicts = False
        for pose in poses:
            if max(map(len, pose.edge)) > MAX_NAME_CHARS:
                continue
            contradicts |= self._static.observe(pose, origin, own, now_ns, latched=latched)
            if not latched and pose.source == FIXTURE_FRAME:
                self._other_fixtures += not self._follow(self._published, pose, origin)
        if contradicts:
            self._check()

    def counts(self) -> Mapping[str, int]:
        """Number of samples of further senders: those not used, and those of `FIXTURE_FRAME`."""
        counts = {
            "samples of a second sender": self._refused,
            f"samples of {FIXTURE_FRAME} of another node": self._other_fixtures,
        }
        return {name: count for name, count in counts.items() if count}

    def close(self) -> None:
        """Stop watching the graph."""
        if self._timer is not None:
            self._ros.cancel(self._timer)

    def _meet(self, names: SenderNames, origin: Origin) -> None:
        """Read the graph before the first sample of a sender is used."""
        if origin.sender is not None and origin.sender not in self._seen:
            self._seen[origin.sender] = None
            if len(self._seen) > 1024:
                del self._seen[next(iter(self._seen))]
            names.refresh()
            self._find_players()

    def _follow(self, frames: FrameSenders, pose: PoseValues, origin: Origin) -> bool:
        if max(map(len, pose.edge)) > MAX_NAME_CHARS or not all(map(is_frame, pose.edge)):
            return True  # refused by the session; must not fill the places of frames
        sample = Sample(pose.ns, _CONTENT.pack(*pose.translation_m, *pose.quaternion, pose.status))
        now_ns = time.monotonic_ns()
        if origin.sender is not None:
            fresh_ns = self._fresh_ns()
            is_accepted = frames.observe(pose.edge, origin.sender, sample, now_ns, fresh_ns)
        else:
            is_accepted = True
            if origin.sequence is not None:
                frames.observe_sequence(pose.edge, origin.sequence, sample, now_ns)
        return is_accepted

    def _own_static(self) -> dict[str, Transform]:
        return {edge.source: edge for edge in self._static_edges()}

    def _read_graph(self) -> None:
        """Run both checks in one timer: a wait for a timer costs the executor more than a check."""
        try:
            self._check()
        finally:
            self._find_players()

    def _check(self) -> None:
        """Update the texts of the faults; the graph is read if there may be one."""
        for names in self._names:
            names.outdate()
        now_ns = time.monotonic_ns()
        edges, own = self._edges(), self._own_static()
        conflicts = self._frames.conflicts(edges, (), now_ns, self._poses.is_present)
        found = [_text(conflict, self._poses) for conflict in conflicts]
        joints = self._joint_trail.check(now_ns, self._joints.is_present)
        if joints or self._joint_sequences.check(now_ns):
            found.append(
                f"second sender of joints on {self._joints.topic}, {self._joints.text(joints)}: "
                "their positions must not mix; expected one sender"
            )
        if self._static.remove_ended(own, now_ns):
            self._restore_static()
        found += self._static.problems(own, {child for _, child in edges}, now_ns)
        self._texts = tuple(found)
        self._log_fixtures(now_ns)

    def _log_fixtures(self, now_ns: int) -> None:
        """Log the senders of `FIXTURE_FRAME` when several begin to send it."""
        found = self._published.conflicts((), [FIXTURE_FRAME], now_ns, self._tf.is_present)
        text = "; ".join(
            f"{conflict.edge[0]} -> {FIXTURE_FRAME} on {self._tf.topic} has several senders, "
            f"{self._tf.text(conflict.senders)}: no session uses it; readers of tf cannot tell "
            "them apart"
            for conflict in found
        )
        if text and not self._fixture_text:
            self._ros.node.get_logger().warning(text)
        self._fixture_text = text

    def _foreign_constraints(self) -> Sequence[str]:
        """A text if the graph lists another publisher on our constraint topic."""
        topic = self._constraint.topic_name
        if not self._ros.is_open or self._ros.node.count_publishers(topic) <= 1:
            return ()
        infos = self._ros.node.get_publishers_info_by_topic(topic)
        others = [info for info in infos if bytes(info.endpoint_gid) != self._own_constraint]
        if not others:
            return ()
        names = [node_name(info) for info in others if info.node_name != UNKNOWN_NODE]
        return (
            f"second publisher of {topic}, {nodes_text(names, len(others) - len(names))}: "
            "controllers cannot tell it from this one; expected one publisher",
        )


def _text(conflict: SenderConflict, names: SenderNames) -> str:
    parent, child = conflict.edge
    what = "closes a loop with edges of another sender" if conflict.loop else "poses must not mix"
    return (
        f"second sender of {parent} -> {child} on {names.topic}, {names.text(conflict.senders)}: "
        f"{what}; expected one sender"
    )
