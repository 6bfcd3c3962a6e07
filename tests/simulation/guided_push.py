"""A hand pushes a simulated arm towards a breathing tumour, without and with the virtual fixture.

In one process and in simulated time: the physics of the shipped world (MuJoCo, 1 kHz), the fixture
of `push_simulation`, and the cooperative controller with its constraints, which arrive late. The
tumour is tracked at 50 Hz with a latency of 20 ms and 0.3 mm of correlated noise. Each push has
another start, another rotation of the tumour and another phase of its breath.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from scipy.spatial.transform import Rotation

from app.control import (
    AdmittanceGains,
    ControllerParameters,
    CooperativeController,
    JointMeasurement,
    PoseMeasurement,
    ToolKinematics,
    WrenchMeasurement,
)
from app.files.paths import shipped
from app.fixture import Constraint, FixtureRule, FreeMotion, PlainConstraint, ProximityEngine
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, Stamp, Transform
from app.simulation import (
    JointVelocityCommand,
    Push,
    ScriptedHand,
    World,
    WorldDescription,
    WorldTracker,
    open_world,
)
from tests.doubles import simulated_message
from tests.fixture.control.push_simulation import Fixture

STILL_S, PUSH_S, RETREAT_S = 1.0, 1.5, 0.5
"""Duration of tracking before the push, of the push and of the retreat."""

CONSTRAINT_EVERY, CONSTRAINT_DELAY_NS = 5, 5 * NS_PER_MS
"""Steps between two constraints, and their delay on the way to the controller."""

VALID_NS = 50 * NS_PER_MS
TRUTH_EVERY = 5
FAR_MM = 1e4


@dataclass(frozen=True, slots=True)
class GuidedPush:
    """The result of a push: lowest true distance, and speed of the tip in mm/s.

    The speed is that of 0.2 s after the retreat begins. ``stops``: steps of the push in which the
    controller did not follow the hand.
    """

    lowest_mm: float
    retreat_mm_s: float
    stops: int


def world_of(description: WorldDescription, seed: int) -> WorldDescription:
    """``description`` with another start of the arm, tumour's rotation and phase of its breath."""
    random = np.random.default_rng(seed)
    (robot,), (tumor,) = description.robots, description.tissues
    spread = {"waist": 0.25, "shoulder": 0.08, "elbow": 0.08, "pitch": 0.35, "roll": 1.5}
    positions = {
        name: robot.positions.get(name, 0.0) + float(random.uniform(-size, size))
        for name, size in spread.items()
    }
    turn = Rotation.random(random_state=random).as_matrix()
    rest = Transform("world", tumor.name, turn, tumor.rest.translation_mm)
    assert description.hand is not None
    end_s = STILL_S + PUSH_S
    pushes = (
        Push(STILL_S, end_s, tumor.name),
        Push(end_s, end_s + RETREAT_S, tumor.name, retreat=True),
    )
    return replace(
        description,
        seed=seed,
        robots=(replace(robot, positions=positions, collision="none"),),
        bodies=(),
        tissues=(replace(tumor, rest=rest, shifts=()),),
        breathing=replace(description.breathing, held_until_s=float(random.uniform(-4.0, 0.0))),
        hand=replace(description.hand, pushes=pushes),
    )


class Guard:
    """The fixture's constraints as messages, late by `CONSTRAINT_DELAY_NS`."""

    def __init__(self, engine: ProximityEngine, enabled: bool) -> None:
        self._fixture = Fixture(engine, free_motion=True)
        self._enabled = enabled
        self._numbers = count(1)
        self._sent: list[PlainConstraint] = []
        self.base_from_tumor: Transform | None = None

    def track(self, samples: Sequence[tuple[Transform, Stamp]]) -> None:
        """Use samples of the tumour that have arrived."""
        self._fixture.add_samples(list(samples))

    def send(self, base_from_tool: Transform, now_ns: int) -> None:
        """Evaluate the pose of the tool and send the constraint."""
        decision, self.base_from_tumor, tumor_from_tool = self._fixture.decide(
            base_from_tool, Stamp(now_ns)
        )
        planes = decision.constraint
        if not self._enabled:
            tip = tumor_from_tool.translation_mm
            plane = [[0, 0, 1]], [-FAR_MM], [tip], [[0, 0, 0]]
            planes = Constraint("tumor", *plane, hold=False, free=FreeMotion(FAR_MM, FAR_MM))
        if planes is None:
            return
        self._sent.append(
            simulated_message(planes, decision.state, next(self._numbers), now_ns, VALID_NS)
        )

    def arrived(self, now_ns: int) -> list[PlainConstraint]:
        """The constraints that have arrived since the last call."""
        found = [each for each in self._sent if each.stamp_ns + CONSTRAINT_DELAY_NS <= now_ns]
        self._sent = self._sent[len(found) :]
        return found


def run_push(
    description: WorldDescription,
    engine: ProximityEngine,
    truth: ProximityEngine,
    seed: int,
    fixture: bool,
) -> GuidedPush:
    """Simulate one push and the retreat after it."""
    world = World(world_of(description, seed))
    about = world.description
    (robot,), (tumor,) = about.robots, about.tissues
    assert robot.tool is not None and about.hand is not None and about.tracker is not None
    tracker = WorldTracker(replace(about.tracker, tracked=(tumor.name,), metal=None), seed)
    latency_ns = round(about.tracker.model.latency_s * NS_PER_S)
    hand = ScriptedHand(about.hand, robot.tool.name)
    guard = Guard(engine, fixture)
    gains = AdmittanceGains(linear_mm_s_n=hand.admittance_mm_s_n, dead_n=0.0, response_s=0.01)
    controller = CooperativeController(
        ToolKinematics(robot.robot, robot.tool.link_from_tool),
        FixtureRule(accept_simulated=True),
        ControllerParameters(gains=gains),
    )
    base_from_world = robot.world_from_base.inverse()
    state, lowest_mm, retreat_mm_s, stops = world.state(), np.inf, 0.0, 0
    before: FloatArray = state.bodies[robot.tool.name].translation_mm
    end_ns = round((STILL_S + PUSH_S + RETREAT_S) * NS_PER_S)
    for step in range(end_ns // about.timestep_ns):
        now_ns, arm = state.time_ns, state.arms[robot.name]
        tracker.observe(state)
        # The stamp of a sample is that of its arrival; the fixture knows the latency.
        guard.track(
            [
                (
                    (base_from_world.renamed(source="tracker") @ sample.transform).renamed(
                        target="robot_base", source="tumor"
                    ),
                    Stamp(sample.stamp.ns - latency_ns),
                )
                for (sample,) in tracker.arrived(now_ns)
            ]
        )
        commands = {}
        wrench = hand.wrench(state)
        if now_ns >= 0.9 * STILL_S * NS_PER_S:
            tool_pose = state.bodies[robot.tool.name]
            base_from_tool = (base_from_world @ tool_pose).renamed(target="robot_base")
            if step % CONSTRAINT_EVERY == 0:
                guard.send(base_from_tool.renamed(source="tool"), now_ns)
            for message in guard.arrived(now_ns):
                controller.receive(message, now_ns)
            assert guard.base_from_tumor is not None
            decision = controller.step(
                JointMeasurement(now_ns, arm.joints, tuple(arm.positions.tolist())),
                WrenchMeasurement(
                    now_ns, base_from_world.rotate(wrench.force_n), np.zeros(3), in_tool=False
                ),
                PoseMeasurement(now_ns, guard.base_from_tumor.inverse()),
                now_ns,
            )
            commands[robot.name] = JointVelocityCommand(
                now_ns, decision.joints, tuple(decision.velocities.tolist())
            )
            is_pushing = STILL_S * NS_PER_S <= now_ns < (STILL_S + PUSH_S) * NS_PER_S
            stops += is_pushing and decision.reason != "follows"
        state = world.step(commands, {robot.tool.name: wrench})
        tip = state.bodies[robot.tool.name].translation_mm
        speed = float(np.linalg.norm(tip - before)) * NS_PER_S / about.timestep_ns
        before, pushed_s = tip, state.time_ns / NS_PER_S - STILL_S
        if PUSH_S + 0.2 <= pushed_s < PUSH_S + 0.201:
            retreat_mm_s = speed
        if step % TRUTH_EVERY == 0:
            pose = state.bodies[tumor.name].inverse() @ state.bodies[robot.tool.name]
            found = truth.evaluate(pose.renamed(target="tumor", source="tool"))
            lowest_mm = min(lowest_mm, found.signed_distance_mm)
    return GuidedPush(lowest_mm, retreat_mm_s, stops)


class Pushes:
    """Pushes in the shipped world, with engines that are built once."""

    def __init__(self) -> None:
        self._description = open_world(shipped("data", "worlds", "lumpectomy"))
        tool, tumor = self._description.robots[0].tool, self._description.tissues[0]
        assert tool is not None
        meshes = replace(tumor.mesh, frame="tumor"), replace(tool.mesh, frame="tool")
        self._engine, self._truth = ProximityEngine(*meshes), ProximityEngine(*meshes)

    def run(self, seed: int, *, fixture: bool) -> GuidedPush:
        """Simulate one push and the retreat after it."""
        return run_push(self._description, self._engine, self._truth, seed, fixture)
