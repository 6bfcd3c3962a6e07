"""Inputs of a live node, and the watches for other senders of the same."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from app.bridge import topics
from app.bridge.igtl_images import IgtlImagePublisher
from app.bridge.live.cautery_input import IgtlCautery, cautery_input
from app.bridge.live.outputs import IMAGE_TOPIC, LiveOutputs
from app.bridge.live.playback_watch import PlaybackWatch
from app.bridge.live.sender_watch import SenderWatch, WatchedInputs, WatchedSession
from app.bridge.live.sources import listen_to_joints, source_of
from app.bridge.publishing.session_publisher import SessionPublisher
from app.case import IgtlSourceEntry, LiveSourceEntry, TfSourceEntry, TopicSourceEntry
from app.geometry import TrackedTransform
from app.igtl import IgtlSource
from app.runtime import Deliver, LiveRun, PreparedLive, Source
from app.session import PlaybackRule

Counts = Callable[[], Mapping[str, int]]
"""Returns counters for diagnostics, by name."""


class LiveInputs:
    """Pose source, joints, cautery and images of a live node, and the watches on the graph.

    The session is made with `playback`, `cautery`, `senders` and `source_problem`. No pose and no
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
            WatchedInputs(
                pose_topic,
                self._joint_topic,
                frozenset() if robot is None else robot.joint_names,
                named_edges(prepared.config.source),
            ),
            constraint=publisher.constraint_publisher,
            own=publisher.publishers,
            restore_static=publisher.publish_static,
            new_sender=self._playback.check,
        )
        self.cautery = cautery_input(self._ros, prepared.config)

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
        watched = WatchedSession(
            edges=lambda: live.edges,
            static_edges=lambda: commands.content.tf_static_edges,
            fresh_ns=lambda: commands.content.margins.stale_after_ns,
        )
        self.senders.start(watched, moving=not is_tf)
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
            strings=self.cautery.receive if isinstance(self.cautery, IgtlCautery) else None,
        )
        counts: list[Counts] = [self._source.counts, self.senders.counts]
        counts += [each.counts for each in (self._images, self.cautery) if each is not None]
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
        self._playback.close()


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
