"""Publish a session on the ROS graph: each step as messages with the stamps of its samples."""

import math
import secrets
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, Protocol, Self

from rclpy.publisher import Publisher
from std_msgs.msg import String

from app.bridge import messages, topics
from app.bridge.constraint_message import ConstraintBuilder
from app.bridge.heartbeat import steady_ns
from app.bridge.node import RosNode
from app.bridge.publishing.constraint_stream import ConstraintStream
from app.bridge.publishing.diagnostics import Diagnostics
from app.bridge.publishing.markers import PreparedShapes, removed_structure
from app.bridge.publishing.serialized import (
    PUBLISH_ALL,
    FrameTree,
    PublishPolicy,
    SerializedJoints,
    SerializedMargin,
    SerializedTransforms,
)
from app.bridge.ros_errors import BridgeError
from app.bridge.tf_topics import tf_message
from app.bridge.topics import Topic
from app.fixture import FixtureDecision, MarginState, Reason
from app.geometry import Stamp, stale_in_ns
from app.hold import RandomBits
from app.runtime import SessionContent, StepTiming, SwitchContent
from app.session import StepResult, StructureStep, governing_name

NODE_NAME = "marginguard"

_UNKNOWN_DECISION = FixtureDecision(
    state=MarginState.UNKNOWN,
    reasons=(Reason.STARTING,),
    proximity=None,
    margin=None,
    constraint=None,
    hold=True,
    stamp=None,
    seq=0,
)


class Endpoints(Protocol):
    """Where messages go: a `RosNode`, or a bag."""

    def publisher(self, topic: Topic) -> Any:
        """Create a publisher on ``topic``."""

    def destroy_publisher(self, publisher: Publisher) -> None:
        """Destroy a publisher that was created here."""

    def warn(self, text: str) -> None:
        """Log a warning."""

    @property
    def definition_problems(self) -> Sequence[str]:
        """Texts about nodes with other definitions of our messages."""


class SessionPublisher:
    """`Output` of a run that publishes tf, constraint, markers, margin and diagnostics.

    Use as ``with SessionPublisher(content) as publisher: publisher.publish(step, timing)``.

    Everything that does not change (static frames, the robot's description, grey surfaces) is
    published latched on construction. ``heartbeat_hz`` repeats the constraint from a thread
    between steps, for a session that follows real time; None publishes one constraint a step.
    ``policy`` selects the shared topics that this node publishes, ``counts`` are those of a live
    source, for diagnostics. ``playback`` describes the recording that the poses come from; it is
    announced on `app.bridge.topics.PLAYBACK`. `publish` and the switch of `prepare` are for one
    thread at a time. With ``ros`` it uses an existing node and leaves it open; it is then closed in
    that node's thread. With ``endpoints`` it creates no node and has no ``ros``. ``random_bits``
    and ``clock_ns`` as in `ConstraintStream`.
    """

    def __init__(
        self,
        content: SessionContent,
        *,
        namespace: str = "",
        domain_id: int | None = None,
        heartbeat_hz: float | None = None,
        policy: PublishPolicy = PUBLISH_ALL,
        counts: Callable[[], Mapping[str, int]] | None = None,
        ros: RosNode | None = None,
        playback: str = "",
        endpoints: Endpoints | None = None,
        random_bits: RandomBits = secrets.randbits,
        clock_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._policy = replace(policy, fixture_frame=content.fixture_frame)
        self._content = content
        self._simulated = content.simulated or bool(playback)
        self._created: list[Publisher] = []
        self._surfaces_state: MarginState | None = None
        self._structure_states: dict[str, MarginState] = {}
        self._structure_publishers: dict[str, Publisher] = {}
        with ExitStack() as opening:
            if endpoints is None:
                self.ros = ros or opening.enter_context(
                    RosNode(NODE_NAME, namespace=namespace, domain_id=domain_id)
                )
            self._endpoints: Endpoints = endpoints or self.ros
            if ros is not None:
                opening.callback(self._destroy_publishers)
            if playback:
                # Created first: other nodes discover endpoints in this order.
                self._publisher(topics.PLAYBACK).publish(String(data=playback))
            self._publishers = {
                topic.name: self._publisher(topic)
                for topic in topics.EVERY_STEP
                if self._publishes(topic)
            }
            self._surfaces_publisher = self._publisher(topics.MARKERS)
            self._static_publisher = self._publisher(topics.TF_STATIC)
            self._edges_left_out: set[tuple[str, str]] = set()
            self._transforms, self._joints = SerializedTransforms(), SerializedJoints()
            self._margin = SerializedMargin()
            self._diagnostics = Diagnostics(counts, lambda: self._endpoints.definition_problems)
            self._constraint_builder = ConstraintBuilder(content)
            self._shapes = PreparedShapes(content)
            self._latch(content)
            description = content.robot_description() if policy.robot else None
            if description is not None:
                self._publisher(topics.ROBOT_DESCRIPTION).publish(String(data=description))
            self.constraint_publisher = self._publishers[topics.CONSTRAINT.name]
            self.constraints = ConstraintStream(
                self.constraint_publisher,
                heartbeat_hz,
                random_bits=random_bits,
                clock_ns=clock_ns,
            )
            opening.callback(self.constraints.close)
            self._open = opening.pop_all()

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Publish everything of ``step``; the clock first, so that no sample is from its future.

        False when the step came too late: the previous constraint has expired meanwhile, this one
        is published on hold, and the session has to latch that hold (`Session.hold`).
        """
        if self._policy.clock:
            self._send(topics.CLOCK, messages.clock_message(step.frame.stamp))
        self._publish_frames(step)
        for sample in step.frame.joints if self._policy.robot else ():
            self._send(topics.JOINT_STATES, self._joints.message(sample))
        message = self._constraint_builder.message(
            step.decision,
            hold_causes=step.hold_causes,
            simulated=self._simulated or bool(step.playback),
            single_source=step.single_source,
            structures=step.structures,
            half_spaces_of=step.half_spaces_of,
            off=step.off,
        )
        # Read before the time that has been spent: a stop in between shortens the validity.
        since_ns = steady_ns()
        valid_ns = self._valid_ns(step, timing.spent_now_ns())
        in_time = self.constraints.publish(message, valid_ns=valid_ns, since_ns=since_ns)
        self._publish_margin(step.decision, step.structures, governing_name(step), step.warnings)
        report = self._diagnostics.report(step, self._content.margins.stale_after_ns)
        if report is not None:
            self._send(topics.DIAGNOSTICS, report)
        return in_time

    def prepare(self, content: SessionContent) -> SwitchContent:
        """Serialise the surfaces of ``content`` where they are new; return the switch to it.

        After a switch to another tumour or registration the margin is UNKNOWN until the next step,
        and that is published at once. The robot's description stays as it was. Raises
        `FrameError` for static transforms that form no tree.
        """
        FrameTree(content.tf_static_edges, self._policy)
        shapes = self._shapes if self._shapes.match(content) else PreparedShapes(content)
        return lambda switched: self._use(switched, shapes)

    def revoke(self) -> None:
        """Do nothing: the next constraint is published on hold."""

    def latch(self, causes: Sequence[str]) -> None:
        """Publish the hold at once, with a nonce of its own."""
        self.constraints.latch(causes)

    def end(self) -> None:
        """Publish hold as the final constraint."""
        self.constraints.hold("inactive")

    @property
    def publishers(self) -> tuple[Publisher, ...]:
        """All publishers of the session."""
        return tuple(self._created)

    def publish_static(self) -> None:
        """Publish the static transforms again. Thread-safe."""
        static = Stamp(0)
        self._static_publisher.publish(
            tf_message((edge, static) for edge in self._content.tf_static_edges)
        )

    def close(self) -> None:
        """End the heartbeat and leave the ROS graph. Idempotent."""
        self._open.close()

    def _use(self, content: SessionContent, shapes: PreparedShapes) -> None:
        if not shapes.match(content):
            raise BridgeError(
                "prepared surfaces: made of another tumour or tool; expected those of the content"
            )
        before, self._content = self._content, content
        self._constraint_builder.use(content)
        if shapes is not self._shapes or content.static_edges != before.static_edges:
            self._shapes = shapes
            # Do this first: the planes of the previous content are not valid for the new one.
            message = self._constraint_builder.message(
                _UNKNOWN_DECISION,
                hold_causes=[Reason.STARTING.text],
                simulated=self._simulated,
            )
            has_started = self.constraints.invalidate(message)
            self._latch(content)
            if has_started:
                self._publish_margin(_UNKNOWN_DECISION)

    def _publisher(self, topic: Topic) -> Publisher:
        self._created.append(self._endpoints.publisher(topic))
        return self._created[-1]

    def _destroy_publishers(self) -> None:
        for publisher in self._created:
            self._endpoints.destroy_publisher(publisher)

    def _valid_ns(self, step: StepResult, spent_ns: int) -> int | None:
        """Time for which the heartbeat may repeat the constraint of ``step`` until it is stale.

        None for one that allows no approach anyway, and in a replay, whose time can be paused.
        """
        decision = step.decision
        if self._policy.clock or decision.state is MarginState.UNKNOWN or decision.stamp is None:
            return None
        limits = self._content.margins.freshness_limits
        return max(0, stale_in_ns(decision.stamp.ns, step.frame.stamp.ns, limits) - spent_ns)

    def _publishes(self, topic: Topic) -> bool:
        if topic is topics.CLOCK:
            return self._policy.clock
        return self._policy.robot or topic is not topics.JOINT_STATES

    def _publish_frames(self, step: StepResult) -> None:
        edges = self._frame_tree.new_edges(step)
        if edges:
            self._send(topics.TF, self._transforms.message(edges))
        for edge, reason in self._frame_tree.left_out.items():
            if edge not in self._edges_left_out:
                self._edges_left_out.add(edge)
                self._endpoints.warn(f"{edge[0]} -> {edge[1]} is not published on tf: {reason}")

    def _publish_margin(
        self,
        decision: FixtureDecision,
        structures: Sequence[StructureStep] = (),
        governing: str = "",
        warnings: Sequence[str] = (),
    ) -> None:
        distance_mm = math.nan
        if decision.state is not MarginState.UNKNOWN and decision.proximity is not None:
            distance_mm = float(decision.proximity.signed_distance_mm)
        self._send(topics.MARGIN_MM, self._margin.distance(distance_mm))
        self._send(topics.MARGIN_COLOR, self._margin.color(decision.state))
        self._send(topics.MARKERS, self._shapes.text(decision, governing, warnings))
        states = {each.name: each.decision.state for each in structures}
        of_tumor = states.pop(self._content.tumor.frame, decision.state)
        self._show_surfaces(of_tumor, states)

    def _show_surfaces(self, state: MarginState, structures: Mapping[str, MarginState]) -> None:
        """Colour the tumour by ``state``, and the further ``structures`` by theirs."""
        if state is not self._surfaces_state:
            self._surfaces_publisher.publish(self._shapes.surfaces(state))
            self._surfaces_state = state
        for name in self._shapes.structures:
            of_structure = structures.get(name, MarginState.UNKNOWN)
            if self._structure_states.get(name) is not of_structure:
                shape = self._shapes.structure(name, of_structure)
                self._structure_publishers[name].publish(shape)
                self._structure_states[name] = of_structure

    def _latch(self, content: SessionContent) -> None:
        """Publish the static transforms of ``content`` and its surfaces in grey."""
        self._frame_tree = FrameTree(content.tf_static_edges, self._policy)
        self.publish_static()
        self._surfaces_state, self._structure_states = None, {}
        for name in self._shapes.structures:
            if name not in self._structure_publishers:
                # Each its own, which keeps its last message for those who subscribe later.
                self._structure_publishers[name] = self._publisher(topics.MARKERS)
        for name in self._structure_publishers.keys() - {*self._shapes.structures}:
            self._structure_publishers[name].publish(removed_structure(name))
        self._show_surfaces(MarginState.UNKNOWN, {})

    def _send(self, topic: Topic, message: object) -> None:
        self._publishers[topic.name].publish(message)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
