"""A live session on the ROS graph: sources in, publishers and the operator's services out."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from app.bridge import topics
from app.bridge.control import GuidancePublisher, TwistLimiter
from app.bridge.displays.display_output import DisplayOutput
from app.bridge.igtl_images import IgtlImagePublisher
from app.bridge.live.cautery_input import IgtlCautery, cautery_input
from app.bridge.live.guard_start import guard_start
from app.bridge.live.joints import listen_to_joints
from app.bridge.live.operator_endpoints import (
    audit_file,
    audit_log,
    case_recorder,
    served_operators,
)
from app.bridge.live.outputs import (
    ChosenDepth,
    FramesProblemLog,
    GuidanceOutput,
    PlaybackLog,
    SetupDoubtLog,
    TwistOutput,
)
from app.bridge.live.playback_watch import PlaybackWatch
from app.bridge.live.sender_watch import SenderWatch, WatchedSession
from app.bridge.live.source import source_of
from app.bridge.node import RosNode
from app.bridge.publishing.frame_tree import PublishPolicy
from app.bridge.publishing.session_publisher import NODE_NAME, SessionPublisher
from app.bridge.qos import INCOMING
from app.bridge.security import check_security
from app.bridge.tf import TransformBuffer
from app.bridge.tf.listener import TfListener
from app.case import IgtlSourceEntry, LiveSourceEntry, TfSourceEntry, TopicSourceEntry
from app.fixture import ProximityEngine, Reason
from app.geometry import TrackedTransform
from app.igtl import IgtlSource
from app.runtime import (
    AuditOutput,
    ComputeProcess,
    Deliver,
    HoldKeeper,
    LiveRun,
    OperatorCommands,
    Output,
    PreparedLive,
    RequestKind,
    RequestLog,
    described_images,
)
from app.session import (
    LiveSession,
    PlaybackRule,
    Session,
    SessionSetup,
    guidance_parameters,
    limiter_parameters,
    load_replacement,
)

IMAGE_TOPIC = "~/image"
"""Images that come over OpenIGTLink, for displays."""

_LOAD_AFTER_S = 2.0
"""The process for new tumours starts so long after the session, when that has been loaded."""


@dataclass(frozen=True, slots=True, eq=False)
class LiveNode:
    """A `LiveRun` with its ROS endpoints, made by `live_node`."""

    live_run: LiveRun

    @property
    def commands(self) -> OperatorCommands:
        """Changes the session."""
        return self.live_run.commands

    def stop(self) -> None:
        """Request the end of `steps`. Thread-safe."""
        self.live_run.stop()


@contextmanager
def live_node(
    prepared: PreparedLive,
    *,
    namespace: str,
    constraint_hz: float,
    ros: RosNode | None = None,
    outputs: Sequence[Output] = (),
    audit: Path | None = None,
    cases: Path | None = None,
    displays: Sequence[str] = (),
) -> Iterator[LiveNode]:
    """Join the ROS graph: subscribe to the source of ``prepared``, serve the operator.

    With ``ros`` it uses that node, in the node's own thread; the owner of the node destroys its
    services and subscriptions. ``outputs`` receive every step after the publishers. ``audit`` is
    the file of the audit log, by default one below the state folder (`audit_file`). Raises
    `SecurityError` if the configuration requires ROS security that this process does not have.
    ``cases`` is the folder of the session's recordings, by default
    one below the state folder (`case_recorder`). ``displays`` are nodes that may send commands, as
    the operators of the configuration.

    Begins on hold if the last run with this namespace or arm was on hold or did not end in an
    orderly way. Raises the errors of `guard_start`.
    """
    config, case, setup = prepared.config, prepared.case, prepared.setup
    entry = config.source
    limits, guides = limiter_parameters(config), guidance_parameters(config)
    counted: list[Callable[[], Mapping[str, int]]] = []
    problems: list[Callable[[], str]] = []
    if config.needs_security:
        check_security(required=True)
    # The nodes of the tracker and of the robot publish their own data.
    policy = PublishPolicy(clock=False, measured=not isinstance(entry, TfSourceEntry), robot=False)
    with (
        guard_start(prepared, NODE_NAME, namespace, ros) as start,
        SessionPublisher(
            prepared.content,
            namespace=namespace,
            heartbeat_hz=constraint_hz,
            policy=policy,
            counts=lambda: {name: n for counts in counted for name, n in counts().items()},
            ros=ros,
        ) as publisher,
        ExitStack() as stack,
    ):
        node = publisher.ros
        robot, named = case.manifest.robot, _named_edges(entry)
        pose_topic, joint_topic = _pose_topic(entry), None if robot is None else robot.joint_states
        inputs = [topic for topic in (pose_topic, joint_topic) if topic is not None]
        playback = PlaybackWatch(node, inputs)
        senders = SenderWatch(
            node,
            WatchedSession(
                pose_topic=pose_topic,
                joint_topic=joint_topic,
                joint_names=frozenset() if setup.robot is None else setup.robot.joint_names,
                edges=lambda: live.edges,
                static_edges=lambda: run.commands.content.tf_static_edges,
                fresh_ns=lambda: run.commands.content.margins.stale_after_ns,
                restore_static=publisher.publish_static,
                named=named,
            ),
            constraint=publisher.constraint_publisher,
            own=publisher.publishers,
            new_sender=playback.check,
        )
        rule = PlaybackRule(playback.found, accepted=case.manifest.provenance.kind == "simulated")
        cautery = cautery_input(node, config)
        live = LiveSession(
            Session(setup, free_motion=True),
            host_ns=_host_clock(config.stamps_of_host),
            stamps_of_host=config.stamps_of_host,
            edges=named,
            playback=rule,
            outside=lambda: _joined(senders.outside(), start.faults(node)),
            source_problem=lambda: "".join(problem() for problem in problems),
            cautery=None if cautery is None else cautery.state,
        )
        opened = stack.enter_context
        log = opened(audit_log(node, publisher.constraints, audit or audit_file(node)))
        buffer = TransformBuffer()
        TfListener(node, buffer, clock=False, qos=INCOMING)
        simulated = prepared.content.simulated and not config.moves_by_simulated
        twists = TwistLimiter(node, buffer, parameters=limits, simulated=simulated)
        guidance = () if guides is None else (GuidanceOutput(GuidancePublisher(node, guides)),)
        recorder = opened(case_recorder(config, namespace, cases))
        pictures: IgtlImagePublisher | None = None
        requests = RequestLog(time.time_ns, time.monotonic_ns)
        images = described_images(case, node.node.resolve_topic_name(IMAGE_TOPIC))
        chosen_depth = ChosenDepth(prepared.content, images)
        recorder.depth = lambda: chosen_depth.choice
        displays_output = DisplayOutput(
            node,
            prepared.content,
            images,
            displays,
            instance_id=publisher.constraints.instance_id,
            holds=publisher.constraints,
            requests=requests,
            recording=lambda: recorder.status,
            image_problem=lambda: "" if pictures is None else pictures.problem,
        )
        run = LiveRun(
            live,
            prepared.content,
            (
                PlaybackLog(node),
                FramesProblemLog(node),
                SetupDoubtLog(node, setup),
                publisher,
                TwistOutput(twists, setup.margins),
                *guidance,
                AuditOutput(log, prepared.content, time.monotonic_ns),
                chosen_depth,
                *outputs,
                displays_output,
            ),
            HoldKeeper(start.state, lambda: publisher.constraints.ended),
            holds=publisher.constraints,
            requests=requests,
            compute=opened(_compute_process(setup)).call,
            recorder=recorder,
        )
        recorder.ended = partial(requests.refused, RequestKind.RECORD, "the recorder")
        requests.listen(log.request)
        instance_id = publisher.constraints.instance_id
        opened(served_operators(node, run, config, displays, instance_id))
        if isinstance(entry, IgtlSourceEntry) and images is not None:
            refused = node.node.get_logger().warning
            pictures = IgtlImagePublisher(
                node, IMAGE_TOPIC, config.image_device, refused, chosen_depth.check
            )
        strings = cautery.receive if isinstance(cautery, IgtlCautery) else None
        received = None if pictures is None else pictures.receive
        deliver: Deliver = live.add
        if images is not None:
            deliver = _noted(live.add, displays_output.note, rule.refuses)
        source = source_of(node, entry, deliver, senders, received, strings)
        if isinstance(source, IgtlSource):
            problems.append(lambda: source.problem)
        senders.start(moving=not isinstance(entry, TfSourceEntry))
        counted += [
            live.left_out,
            source.counts,
            senders.counts,
            lambda: {"callbacks that failed": node.failures},
            lambda: {f"twists refused: {why}": n for why, n in dict(twists.refused).items()},
        ]
        counted += [each.counts for each in (pictures, cautery) if each is not None]
        if joint_topic is not None:
            offset_ns = case.manifest.clock.offset_robot_to_tracker_ns
            add_joints = partial(live.add_joints, of_host=config.joints_of_host)
            joints = listen_to_joints(
                node,
                joint_topic,
                offset_ns,
                add_joints,
                senders.accepts_joints,
                lambda names: setup.robot is None or setup.robot.is_posed_by(names),
            )
            counted.append(joints.counts)
        try:
            yield LiveNode(run)
        finally:
            twists.close()
            source.close()
            if pictures is not None:
                pictures.close()
            senders.close()
            playback.close()


def _noted(deliver: Deliver, note: Deliver, refuses: Callable[[], bool]) -> Deliver:
    """``deliver`` that also gives the poses to ``note``, unless the session refuses them."""

    def deliver_both(samples: Sequence[TrackedTransform]) -> None:
        deliver(samples)
        if not refuses():
            note(samples)

    return deliver_both


def _compute_process(setup: SessionSetup) -> ComputeProcess:
    """The process that prepares a new tumour, loaded while the session waits to be re-armed."""
    process = ComputeProcess()
    if isinstance(setup.proximity, ProximityEngine):
        process.start_after(_LOAD_AFTER_S, load_replacement)
    return process


def _named_edges(entry: LiveSourceEntry) -> Sequence[tuple[str, str]]:
    return entry.edges if isinstance(entry, TfSourceEntry) else ()


def _pose_topic(entry: LiveSourceEntry) -> str | None:
    """Topic of the measured poses; None for a source that is not on the graph."""
    if isinstance(entry, TfSourceEntry):
        return topics.TF.name
    return entry.topic if isinstance(entry, TopicSourceEntry) else None


def _host_clock(stamps_of_host: bool) -> Callable[[], int]:
    """System time if stamps are of this host; otherwise a clock that NTP does not set back."""
    if stamps_of_host:
        return time.time_ns
    offset_ns = time.time_ns() - time.monotonic_ns()
    return lambda: offset_ns + time.monotonic_ns()


def _joined(first: Mapping[Reason, str], second: Mapping[Reason, str]) -> Mapping[Reason, str]:
    """Faults of both, with both texts where a reason is in both."""
    if not first or not second:
        return first or second
    texts = {
        reason: f"{first[reason]}; {second[reason]}" for reason in first.keys() & second.keys()
    }
    return {**first, **second, **texts}
