"""Inputs of a live node, and the watches for other senders of the same."""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial

from rclpy.node import NodeNameNonExistentError
from std_msgs.msg import String

from app.bridge import topics
from app.bridge.live.outputs import IMAGE_TOPIC, LiveOutputs
from app.bridge.live.sender_watch import SenderWatch
from app.bridge.live.sources import IgtlActivation, activation_input, listen_to_joints, source_of
from app.bridge.message_definitions import UNKNOWN_NODE
from app.bridge.node import RosNode
from app.bridge.publishing.session_publisher import SessionPublisher
from app.bridge.sender_names import node_name
from app.bridge.tracker_publisher import IgtlImagePublisher
from app.case import IgtlSourceEntry, LiveSourceEntry, TfSourceEntry, TopicSourceEntry
from app.geometry import TrackedTransform
from app.igtl import IgtlSource
from app.runtime import Deliver, LiveRun, PreparedLive, Source
from app.session import PlaybackRule

LINGER_S = 1.0
"""Time after the end of a playback for which it counts as found: its last samples may wait."""

BAG_PLAYER = "rosbag2_player"
"""Beginning of the name that ``ros2 bag play`` gives its node."""

BAG_SERVICES = frozenset({"get_rate", "burst"})
"""Services that ``ros2 bag play`` offers below the name of its node, whatever that is."""

_MAX_CHARS = 200

Counts = Callable[[], Mapping[str, int]]
"""Returns counters for diagnostics, by name."""


class PlaybackWatch:
    """``found()`` describes the playback that is on the graph now.

    A playback exists as long as its announcement has a publisher, or as long as ``ros2 bag play``
    publishes on one of the ``inputs`` of the session. The endpoints of a killed process leave the
    graph when its lease has expired, after 20 s at most with Fast DDS. The text of the announcement
    only adds the name of the case: it may arrive later, or never.

    `check` looks for bag players: call it in the node's thread, repeatedly and before the first
    sample of a new sender is used. `found` is thread-safe.
    """

    def __init__(self, ros: RosNode, inputs: Collection[str]) -> None:
        self._ros = ros
        self._inputs = tuple(inputs)
        self._case = ""
        self._player = ""
        self._last_player = ""
        self._seen_s: float | None = None
        ros.subscribe(topics.PLAYBACK, self._receive)

    def check(self) -> None:
        """Look for a bag player among the publishers of the inputs."""
        if not self._ros.is_open:
            return
        players = {
            node_name(info)
            for topic in self._inputs
            for info in self._ros.node.get_publishers_info_by_topic(topic)
            if self._is_player(info.node_name, info.node_namespace)
        }
        self._player = min(players, default="")

    def found(self) -> str:
        """Description of the playback; empty if there is none."""
        now_s, player, seen_s = time.monotonic(), self._player, self._seen_s
        if player:
            self._last_player = player
        is_announced = self._ros.is_open and self._ros.node.count_publishers(topics.PLAYBACK.name)
        if player or is_announced:
            self._seen_s = seen_s = now_s
        if seen_s is None:  # the text may arrive before its publisher is on the graph: keep it
            return ""
        if now_s - seen_s > LINGER_S:
            self._case, self._last_player, self._seen_s = "", "", None
            return ""
        last = self._last_player
        details = f"played by the node {last}" if last else self._case
        return f"poses from a recording, {details}" if details else "poses from a recording"

    def _is_player(self, name: str, namespace: str) -> bool:
        if name.startswith(BAG_PLAYER):
            return True
        if name == UNKNOWN_NODE:
            return False
        try:
            services = self._ros.node.get_service_names_and_types_by_node(name, namespace)
        except NodeNameNonExistentError:  # it has left
            return False
        own = f"{namespace.rstrip('/')}/{name}/"
        return {each.removeprefix(own) for each, _ in services} >= BAG_SERVICES

    def _receive(self, message: String) -> None:
        text = message.data[:_MAX_CHARS]
        self._case = "".join(each if each.isprintable() else " " for each in text)


class LiveInputs:
    """Pose source, joints, activation and images of a live node, and the watches on the graph.

    The session is made with `playback`, `activation`, `senders` and `source_problem`. No pose, no
    joints arrive before `connect`. ``publisher`` is that of the session: its node receives, and
    other publishers of its topics are faults.
    """

    def __init__(self, prepared: PreparedLive, publisher: SessionPublisher) -> None:
        self._prepared, self._ros = prepared, publisher.ros
        self._source: Source | None = None
        self._images: IgtlImagePublisher | None = None
        manifest, robot = prepared.case.manifest, prepared.setup.robot
        pose_topic = _pose_topic(prepared.config.source)
        self._joint_topic = None if manifest.robot is None else manifest.robot.joint_states
        received = [topic for topic in (pose_topic, self._joint_topic) if topic is not None]
        self._playback = PlaybackWatch(self._ros, received)
        self.playback = PlaybackRule(
            self._playback.found, accepted=manifest.provenance.kind == "simulated"
        )
        self.senders = SenderWatch(
            self._ros,
            pose_topic,
            self._joint_topic,
            frozenset() if robot is None else robot.joint_names,
            named_edges(prepared.config.source),
            constraint=publisher.constraint_publisher,
            own=publisher.publishers,
            restore_static=publisher.publish_static,
            find_players=self._playback.check,
        )
        self.activation = activation_input(self._ros, prepared.config)

    def source_problem(self) -> str:
        """The reason why the source cannot send; empty if it can."""
        return self._source.problem if isinstance(self._source, IgtlSource) else ""

    def image_problem(self) -> str:
        """The reason why the last image over OpenIGTLink was refused; empty if it was accepted."""
        return "" if self._images is None else self._images.problem

    def connect(self, run: LiveRun, outputs: LiveOutputs) -> list[Counts]:
        """Pass samples to the session of ``run`` from now on; return the counters of all inputs.

        Displays place the images of ``outputs`` by the same samples.
        """
        config, live, commands = self._prepared.config, run.live, run.commands
        is_tf = isinstance(config.source, TfSourceEntry)
        self.senders.start(
            edges=lambda: live.edges,
            static_edges=lambda: commands.content.tf_static_edges,
            fresh_ns=lambda: commands.content.margins.stale_after_ns,
            moving=not is_tf,
        )
        deliver: Deliver = live.add
        if outputs.images is not None:
            deliver = _noted(live.add, outputs.displays.note, self.playback.refuses)
            if isinstance(config.source, IgtlSourceEntry):
                self._images = IgtlImagePublisher(
                    self._ros, IMAGE_TOPIC, config.image_device, self._ros.warn, outputs.depth.check
                )
        self._source = source_of(
            self._ros,
            config.source,
            deliver,
            self.senders,
            images=None if self._images is None else self._images.receive,
            strings=self.activation.receive
            if isinstance(self.activation, IgtlActivation)
            else None,
        )
        counts: list[Counts] = [self._source.counts, self.senders.counts]
        counts += [each.counts for each in (self._images, self.activation) if each is not None]
        if self._joint_topic is not None:
            robot = self._prepared.setup.robot
            joints = listen_to_joints(
                self._ros,
                self._joint_topic,
                self._prepared.case.manifest.clock.offset_robot_to_tracker_ns,
                partial(live.add_joints, of_host=config.joints_of_host),
                self.senders.accepts_joints,
                lambda names: robot is None or robot.is_posed_by(names),
            )
            counts.append(joints.counts)
        return counts

    def close(self) -> None:
        """Receive no more poses and images; stop watching the graph."""
        if self._source is not None:
            self._source.close()
        if self._images is not None:
            self._images.close()
        self.senders.close()


def named_edges(entry: LiveSourceEntry) -> Sequence[tuple[str, str]]:
    """The edges that the configuration names; empty where the session finds them."""
    return entry.edges if isinstance(entry, TfSourceEntry) else ()


def _pose_topic(entry: LiveSourceEntry) -> str | None:
    """Topic of the measured poses; None for a source that is not on the graph."""
    if isinstance(entry, TfSourceEntry):
        return topics.TF.name
    return entry.topic if isinstance(entry, TopicSourceEntry) else None


def _noted(deliver: Deliver, note: Deliver, refuses: Callable[[], bool]) -> Deliver:
    """``deliver`` that also gives the poses to ``note``, unless the session refuses them."""

    def deliver_both(samples: Sequence[TrackedTransform]) -> None:
        deliver(samples)
        if not refuses():
            note(samples)

    return deliver_both
