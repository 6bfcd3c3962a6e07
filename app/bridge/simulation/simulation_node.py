"""The ROS node of a simulated world.

======================== ============================== ==========================================
``/NAME/...``            see `arm_endpoint`             one arm
``/tracked_transforms``  marginguard_msgs/              what the tracker measures, and ``/tf``:
                         TrackedTransform               ``tracker`` to ``NAME_sensor``
``/tf``                  tf2_msgs/TFMessage             the truth: ``world`` to ``truth/NAME`` of
                                                        every body, with one common stamp
``/clock``               rosgraph_msgs/Clock            see `ClockTopic`; only if asked for
``~/real_time_factor``   std_msgs/Float64               simulated seconds per second
``~/reset``, ``~/pause`` std_srvs/Trigger               begin again at 0; stand still
``~/resume``, ``~/step`` std_srvs/Trigger               go on; take one step and stand still
``/NAME/enable``         std_srvs/Trigger               end the FAULT of an arm
``~/move_bodies``,       see `world_bodies`             a user moves, adds or removes a body
``~/edit_body``
``~/bodies``             visualization_msgs/MarkerArray their surfaces, latched: see `BodyShapes`
======================== ============================== ==========================================

A session must not follow the truth: its frames have names of their own. Stamps are host time.
"""

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Float64

from app.bridge import topics
from app.bridge.calls.service_server import trigger_server
from app.bridge.messages import diagnostic_status, header_message
from app.bridge.node import RosNode
from app.bridge.simulation.arm_endpoint import ArmEndpoint, has_reader
from app.bridge.simulation.hand_inputs import DeviceHand
from app.bridge.simulation.real_time import ClockTopic, RealTime
from app.bridge.simulation.world_bodies import BodyEdits, BodyShapes
from app.bridge.tf_poses import write_tf_message
from app.bridge.topics import STREAM, Topic
from app.bridge.tracker_publisher import TrackerPublisher
from app.bridge.world_client import SIMULATION, TRUTH, tf_sample
from app.geometry import NS_PER_MS, Stamp, TrackedTransform
from app.simulation import (
    ArmCommand,
    CommandError,
    ScriptedHand,
    StateCommand,
    World,
    WorldDescription,
    WorldState,
    WorldTracker,
    Wrench,
)

NODE_NAME = SIMULATION

SENSOR = "_sensor"
"""Suffix of the frame in which a body is tracked: its sensor, at its origin."""


class Hand(Protocol):
    """A hand on the tool ``tool``."""

    @property
    def tool(self) -> str:
        """Name of the tool."""

    def wrench(self, state: WorldState) -> Wrench:
        """The wrench on the tool in ``state``."""


STATE_PERIOD_NS = 5 * NS_PER_MS
CLOCK_PERIOD_NS = 10 * NS_PER_MS
_SENDERS_PERIOD_NS = 50 * NS_PER_MS


class SimulationNode:
    """Connects a world to ROS; the `Shell` of `RealTime.run`.

    ``send_poses`` receives the tracker's samples, with the names of the bodies, instead of
    ``/tracked_transforms`` and ``/tf``. ``use_hand`` false leaves out the scripted hand of the
    world; ``hand`` is used instead of it. ``clock``: publish ``/clock`` (`ClockTopic`).
    """

    def __init__(
        self,
        ros: RosNode,
        description: WorldDescription,
        *,
        use_hand: bool = True,
        hand: Hand | None = None,
        send_poses: Callable[[Sequence[TrackedTransform]], None] | None = None,
        clock: bool = False,
    ) -> None:
        self._tools = {each.name: each.tool.name for each in description.robots if each.tool}
        self._tf = ros.publisher(topics.TF)
        self._diagnostics = ros.publisher(topics.DIAGNOSTICS)
        self._factor = ros.publisher(Topic("~/real_time_factor", Float64, STREAM))
        self._description = description
        self._suffix = SENSOR if send_poses is None else ""
        if send_poses is None and description.tracker is not None:
            send_poses = TrackerPublisher(ros).publish
        self._send_poses = send_poses
        self._tracker = self._new_tracker()
        self._hand = hand
        script = description.hand
        if script is not None and script.pushes and use_hand and hand is None:
            self._hand = ScriptedHand(script, self._tools[script.robot])
        held = None if self._hand is None else self._hand.tool
        self._arms = {
            each.name: ArmEndpoint(
                ros, each, has_hand=held is not None and self._tools.get(each.name) == held
            )
            for each in description.robots
        }
        self._edits = BodyEdits(ros)
        self._shapes = BodyShapes(ros, description)
        self.clock = ClockTopic(ros) if clock else None
        self._wrench: Wrench | None = None
        self._checked_ns: int | None = None
        self._enabled: deque[str] = deque()
        self._state: WorldState | None = None
        self._stamp_ns = 0
        self._statuses: tuple[str, ...] = ()
        self._lags = 0
        self._ros = ros

    def serve(self, pace: RealTime) -> None:
        """Serve the controls of ``pace`` and the arms until the node is closed."""
        for name, action in (
            ("~/reset", pace.reset),
            ("~/pause", pace.pause),
            ("~/resume", pace.resume),
            ("~/step", pace.step_once),
        ):
            trigger_server(self._ros, name, action)
        for arm in self._arms:
            trigger_server(self._ros, f"/{arm}/enable", partial(self._enabled.append, arm))

    def idle(self) -> None:
        """Let a haptic device rest while the world is paused; see `Shell`."""
        if isinstance(self._hand, DeviceHand):
            self._hand.rest()

    def close(self) -> None:
        """End the force on a haptic device. Call it after the last step."""
        self.idle()

    def step(self, world: World, now_ns: int) -> WorldState:
        """Step with the newest commands and the hand; see `Shell`."""
        while self._enabled:
            name = self._enabled.popleft()
            fault = world.state().arms[name].fault
            world.enable(name)
            self._arms[name].commands.enabled(fault)
            self._checked_ns = None
        changes = self._edits.apply(world, now_ns)
        for change in changes:
            for name in self._arms:
                world.fail(name, change)
        if changes:
            self._shapes.publish(world.description)
        self._change_states(world)
        before = world.state()
        if self._state is not None and before.time_ns < self._state.time_ns:  # a reset
            self._tracker, self._checked_ns = self._new_tracker(), None
            self.idle()
        self._check_senders(world, before)
        commands: dict[str, ArmCommand] = {}
        for name, arm in self._arms.items():
            command = arm.commands.newest(now_ns, world.time_ns)
            if command is not None and not before.arms[name].fault:
                commands[name] = command
        wrenches = {}
        if self._hand is not None:
            self._wrench = wrenches[self._hand.tool] = self._hand.wrench(before)
        try:
            return world.step(commands, wrenches)
        except CommandError:  # the arm is in FAULT now, which `publish` reports
            return world.step({}, wrenches)

    def publish(self, state: WorldState, stamp_ns: int) -> None:
        """Publish what is due; see `Shell`."""
        self._state, self._stamp_ns = state, stamp_ns
        if self._tracker is not None and self._send_poses is not None:
            self._tracker.observe(state)
            for samples in self._tracker.arrived(state.time_ns):
                on_host = [self._on_host(sample, stamp_ns - state.time_ns) for sample in samples]
                self._send_poses(on_host)
        if state.time_ns % STATE_PERIOD_NS == 0:
            self._publish_state(state, Stamp(stamp_ns))
        if self.clock is not None and state.time_ns % CLOCK_PERIOD_NS == 0:
            self.clock.publish(stamp_ns)
        for name, arm_state in state.arms.items():
            self._arms[name].operating.publish(arm_state, Stamp(stamp_ns))
        statuses = tuple(each.fault or each.status for each in state.arms.values())
        if statuses != self._statuses:
            self._statuses = statuses
            self._publish_diagnostics(state)
            for name, arm in state.arms.items():
                if arm.fault:
                    self._ros.node.get_logger().error(f"arm {name!r} is in FAULT: {arm.fault}")

    def report(self, real_time_factor: float, lags: int) -> None:
        """Publish the factor and the diagnostics; see `Shell`."""
        self._lags = lags
        self._factor.publish(Float64(data=real_time_factor))
        if self._state is not None:
            self._publish_diagnostics(self._state)

    def _new_tracker(self) -> WorldTracker | None:
        tracker = self._description.tracker
        return None if tracker is None else WorldTracker(tracker, self._description.seed)

    def _publish_diagnostics(self, state: WorldState) -> None:
        statuses = [arm.status(state.arms[name]) for name, arm in self._arms.items()]
        level = DiagnosticStatus.WARN if self._lags else DiagnosticStatus.OK
        text = f"{self._lags} times behind real time" if self._lags else "real time"
        pace = diagnostic_status("simulation", level, text, {"lags": self._lags})
        edits = DiagnosticStatus(
            name="marginguard: edits of bodies",
            message=f"{self._edits.applied} applied, {self._edits.refused} refused",
        )
        header = header_message("", Stamp(self._stamp_ns))
        self._diagnostics.publish(DiagnosticArray(header=header, status=[pace, edits, *statuses]))

    def _publish_state(self, state: WorldState, stamp: Stamp) -> None:
        for name, arm in self._arms.items():
            tool = self._tools.get(name)
            is_held = self._hand is not None and self._hand.tool == tool
            arm.publish(
                state.arms[name],
                None if tool is None else state.bodies[tool],
                self._wrench if is_held else None,
                stamp,
            )
        if has_reader(self._tf):
            self._tf.publish(
                write_tf_message(
                    tf_sample(pose.renamed(source=f"{TRUTH}{pose.source}"), stamp)
                    for pose in state.bodies.values()
                )
            )

    def _change_states(self, world: World) -> None:
        """Do what has arrived on ``state_command``."""
        for name, arm in self._arms.items():
            for command in arm.operating.commands():
                fault = world.state().arms[name].fault
                try:
                    world.request(name, command)
                except CommandError as error:
                    self._ros.node.get_logger().warning(str(error))
                    continue
                if command is StateCommand.ENABLE:
                    arm.commands.enabled(fault)
                    self._checked_ns = None

    def _check_senders(self, world: World, state: WorldState) -> None:
        """Stop an arm that another node commands than its controller."""
        last_ns = self._checked_ns
        is_due = last_ns is None or not 0 <= world.time_ns - last_ns < _SENDERS_PERIOD_NS
        if is_due:
            self._checked_ns = world.time_ns
        for name, arm in self._arms.items():
            if state.arms[name].fault or not (is_due or arm.commands.binding.is_due):
                continue
            problem = arm.commands.other_controller()
            if problem:
                world.fail(name, problem)

    def _on_host(self, sample: TrackedTransform, offset_ns: int) -> TrackedTransform:
        """``sample`` as one of the body's sensor, with its stamp on the host's clock."""
        sensor, pose = f"{sample.source}{self._suffix}", sample.transform
        return TrackedTransform(
            None if pose is None else pose.renamed(source=sensor),
            Stamp(sample.stamp.ns + offset_ns),
            sample.status,
            sample.target,
            sensor,
        )
