"""A simulated robot inserts a needle past a vessel to a breathing target, in simulated time.

The physics are MuJoCo's, the poses those of a tracker with correlated errors, late by its latency.
The true anatomy is beside the planned one by an error of registration. At each tracker frame a
`Session` guards chest wall and vessel, and its constraint is joined with that of the path; the
controller has `FixtureRule` alone, and pushes the tip towards the planned target. Coal judges the
distance of needle and vessel at each control step.
"""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from app.control import ToolKinematics
from app.files.paths import shipped
from app.fixture import ProximityEngine, prepared_tumor
from app.geometry import NS_PER_S, FloatArray, SurfaceMesh, Transform
from app.planning import (
    EntryRegion,
    ForbiddenStructure,
    Needle,
    NeedlePath,
    NeedleRobot,
    NeedleTarget,
    plan_needle,
)
from app.robot import load_robot
from app.session import Role, Session, SessionSetup, Structure
from app.simulation import (
    ArmCommand,
    BodyEntry,
    BreathingEntry,
    RobotEntry,
    TissueEntry,
    TissueShift,
    ToolEntry,
    TrackerEntry,
    World,
    WorldDescription,
    WorldState,
    WorldTracker,
)
from app.synthetic.tracker_model import Jitter, TrackerModel
from tests.doubles import PARAMETERS
from tests.oracles.needle_oracle import NeedleOracle
from tests.planning.needle_controller import (
    LENGTH_MM,
    REST_S,
    TRACKING,
    WINDOW_MM,
    NeedleController,
)

NEEDLE = Needle(length_mm=LENGTH_MM, diameter_mm=1.2, bend_mm=0.0)
TARGET_MM = np.array([180.0, 0.0, 50.0])
WORLD_FROM_REFERENCE = Transform("world", "reference", np.eye(3), [180.0, 60.0, 100.0])
"""The sensor on the patient, beside the target."""

VESSEL = "vessel_sensor"
VESSEL_MM, VESSEL_RADIUS_MM = np.array([180.0, 0.0, 85.0]), 3.0
CHEST_WALL_MM = np.array([180.0, 0.0, 20.0])
STOP_MM, K_SIGMA = 2.0, 2.0

TRACKER = TrackerModel(
    "needle",
    rate_hz=50.0,
    white=Jitter(0.05, math.radians(0.03)),
    slow=Jitter(0.25, math.radians(0.05)),
    correlation_s=0.5,
    latency_s=0.02,
)
REGISTRATION_MM = 0.5
"""Standard deviation along each axis."""
BREATH_MM = np.array([0.0, 4.0, 3.0])
MAX_S, BLOCKED_S = 30.0, 3.0
"""Largest duration of an insertion, and that of one that is blocked."""

CONTROL_STEPS = 5
"""Steps of the physics, of 1 ms, in a control step."""


def covariance_mm2() -> FloatArray:
    """Covariance (3, 3) of the needle's place at the target, as ``docs/planning.md`` says."""
    lever_mm = float(np.linalg.norm(TARGET_MM - WORLD_FROM_REFERENCE.translation_mm))
    variance = TRACKING.sigma_between(0.0, lever_mm) ** 2 + REGISTRATION_MM**2
    breath = BREATH_MM / np.linalg.norm(BREATH_MM)
    return np.asarray(variance * np.eye(3) + WINDOW_MM**2 * np.outer(breath, breath))


def predicted_mm(share: float) -> float:
    """The lateral error that this share of normal errors with that covariance is below."""
    corridor = operation().corridor
    basis = np.linalg.svd((corridor.target_mm - corridor.entry_mm)[None])[2][1:]
    covariance = basis @ covariance_mm2() @ basis.T
    errors = np.random.default_rng(0).multivariate_normal(np.zeros(2), covariance, 200_000)
    return float(np.quantile(np.linalg.norm(errors, axis=1), share))


def needle_mesh() -> SurfaceMesh:
    """A capsule with its tip at the origin and +z forward."""
    radius = NEEDLE.diameter_mm / 2.0
    made = trimesh.creation.capsule(NEEDLE.length_mm - 2.0 * radius, radius, count=[8, 8])
    return SurfaceMesh("tip", made.vertices - [0.0, 0.0, made.bounds[1][2]], made.faces)


def vessel_mesh() -> SurfaceMesh:
    """A tube along y."""
    made = trimesh.creation.cylinder(VESSEL_RADIUS_MM, 60.0, sections=24)
    made.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2.0, [1, 0, 0]))
    return SurfaceMesh("vessel", made.vertices, made.faces)


@dataclass(frozen=True)
class Insertion:
    """Result of an insertion.

    ``lateral_mm``: true lateral distance of the tip from the target on arrival, None without one.
    ``left_mm``: depth from the tip to the target at the end. ``vessel_mm``: lowest distance of
    needle and vessel; ``path_mm``: that of the whole path and the vessel at the end. Both by coal.
    ``waited_s``: time in which the target was away.
    """

    lateral_mm: float | None
    left_mm: float
    vessel_mm: float
    path_mm: float
    waited_s: float


class Operation:
    """The plan, the engines and the robot, which all insertions share."""

    def __init__(self) -> None:
        self._robot = load_robot(shipped("data", "robots", "touch", "touch.urdf"))
        self._link_from_tip = Transform("stylus", "tip", np.eye(3), [0.0, 0.0, 100.0])
        reference_from_root = WORLD_FROM_REFERENCE.inverse().renamed(source=self._robot.root_link)
        to_plan = reference_from_root.translation_mm  # the axes are the same
        vessel = vessel_mesh()
        placed = SurfaceMesh("reference", vessel.vertices_mm + VESSEL_MM + to_plan, vessel.faces)
        skin_mm = TARGET_MM + to_plan + np.array([0.0, 0.0, 80.0])
        self.corridor = plan_needle(
            EntryRegion.of_disc("reference", skin_mm, [0.0, 0.0, 1.0], 30.0, count=3000),
            NeedleTarget.of_points("reference", [TARGET_MM + to_plan]),
            NEEDLE,
            [ForbiddenStructure("vessel", placed, STOP_MM, 0.0)],
            error=covariance_mm2(),
            k_sigma=K_SIGMA,
            robot=NeedleRobot(self._robot, reference_from_root, self._link_from_tip),
        ).best
        wall = trimesh.creation.box([80.0, 80.0, 6.0])
        first = ProximityEngine(
            SurfaceMesh("chest_wall", wall.vertices, wall.faces), needle_mesh(), field_nodes=20_000
        )
        wall_mm = CHEST_WALL_MM + to_plan
        self._setup = SessionSetup(
            tool_from_tip=Transform.identity("needle", "tip"),
            frame_from_tumor=Transform("reference", "chest_wall", np.eye(3), wall_mm),
            proximity=first,
            margins=PARAMETERS.replaced(stop_mm=STOP_MM, warn_mm=STOP_MM + 4.0, k_tre=K_SIGMA),
            robot=None,
            tracking=TRACKING,
            structures=(
                Structure(
                    Transform.identity(VESSEL, "vessel"),
                    first.with_tumor(prepared_tumor(vessel, 20_000)),
                    STOP_MM,
                    STOP_MM + 4.0,
                    role=Role.FORBIDDEN,
                ),
            ),
        )

    def insert(
        self, seed: int, *, vessel_moves: bool = False, is_guarded: bool = True
    ) -> Insertion:
        """Insert the needle; with ``vessel_moves`` the vessel moves into the way meanwhile."""
        rng = np.random.default_rng(seed)
        world = World(self._world(rng, vessel_moves))
        assert world.description.tracker is not None
        tracker = WorldTracker(world.description.tracker, seed)
        controller = self._controller(rng, is_guarded)
        judge = NeedleOracle(vessel_mesh())
        end_ns = round((MAX_S if not vessel_moves else BLOCKED_S) * NS_PER_S)
        state, lowest_mm, waited = world.state(), math.inf, 0
        commands: dict[str, ArmCommand] = {}
        while state.time_ns < end_ns and not controller.has_arrived:
            tracker.observe(state)
            for samples in tracker.arrived(state.time_ns):
                controller.track(samples, state.time_ns)
            if state.time_ns // world.description.timestep_ns % CONTROL_STEPS == 0:
                commands = {"arm": controller.command(state.arms["arm"], state.time_ns)}
                shaft = np.array([[0.0, 0.0, -NEEDLE.length_mm], [0.0, 0.0, 0.0]])
                lowest_mm = min(lowest_mm, _clearance(judge, state, state.bodies["needle"], shaft))
                waited += controller.is_waiting
            state = world.step(commands)
        corridor = self.corridor
        ends = np.stack([corridor.entry_mm, corridor.target_mm])
        way = (ends[1] - ends[0]) / corridor.depth_mm
        missed = state.bodies["needle"].translation_mm - state.bodies["target"].translation_mm
        return Insertion(
            float(np.linalg.norm(np.cross(missed, way))) if controller.has_arrived else None,
            -float(missed @ way),
            lowest_mm,
            _clearance(judge, state, WORLD_FROM_REFERENCE, ends),
            waited * CONTROL_STEPS * world.description.timestep_ns / NS_PER_S,
        )

    def _world(self, rng: np.random.Generator, vessel_moves: bool) -> WorldDescription:
        corridor, to_world = self.corridor, WORLD_FROM_REFERENCE.translation_mm
        error_mm = rng.normal(scale=REGISTRATION_MM, size=3)
        shifts: tuple[TissueShift, ...] = ()
        if vessel_moves:
            way = corridor.target_mm - corridor.entry_mm
            entry = corridor.entry_mm + to_world
            at_vessel = entry + way * ((VESSEL_MM - entry)[2] / way[2])
            start_s = REST_S + rng.uniform(0.1, 0.6)
            shifts = (TissueShift(start_s, start_s + 0.5, at_vessel - VESSEL_MM),)
        ball = trimesh.creation.icosphere(1, 2.0)
        target = SurfaceMesh("target", ball.vertices, ball.faces)
        sensor, vessel = replace(target, frame="reference"), replace(vessel_mesh(), frame=VESSEL)
        needle = replace(needle_mesh(), frame="needle")
        link_from_needle = self._link_from_tip.renamed(source="needle")
        tool = ToolEntry("needle", "stylus", needle, link_from_needle, 0.02, 0.3, "none")
        arm = RobotEntry(
            "arm",
            self._robot,
            Transform.identity("world", self._robot.root_link),
            corridor.joints[0],
            density_kg_m3=1000.0,
            armature_kg_m2=0.005,
            collision="none",
            tool=tool,
        )

        def at(name: str, place_mm: FloatArray) -> Transform:
            return Transform("world", name, np.eye(3), place_mm + error_mm)

        still = np.zeros(3)
        return WorldDescription(
            "insertion",
            seed=0,
            robots=(arm,),
            bodies=(BodyEntry("reference", sensor, WORLD_FROM_REFERENCE, None, 0.3, "none"),),
            tissues=(
                TissueEntry("target", target, at("target", TARGET_MM), BREATH_MM, still),
                TissueEntry(VESSEL, vessel, at(VESSEL, VESSEL_MM), still, still, shifts),
            ),
            breathing=BreathingEntry(rng.uniform(0.25, 0.5), REST_S + rng.uniform(0.0, 1.0)),
            tracker=TrackerEntry(("needle", "reference", "target", VESSEL), TRACKER),
        )

    def _controller(self, rng: np.random.Generator, is_guarded: bool) -> NeedleController:
        """A controller that knows the robot's base but for an error of 0.3 degrees."""
        rule_from_world = (WORLD_FROM_REFERENCE @ self._setup.frame_from_tumor).inverse()
        turn = Rotation.from_rotvec(rng.normal(scale=math.radians(0.3), size=3)).as_matrix()
        exact = rule_from_world.renamed(source=self._robot.root_link)
        path = NeedlePath("reference", self.corridor.entry_mm, self.corridor.target_mm)
        return NeedleController(
            path.in_frame(self._setup.frame_from_tumor.inverse()),
            Session(self._setup, free_motion=True),
            ToolKinematics(self._robot, self._link_from_tip),
            replace(exact, rotation=exact.rotation @ turn),
            is_guarded,
        )


def _clearance(
    judge: NeedleOracle, state: WorldState, world_from_axis: Transform, ends_mm: FloatArray
) -> float:
    """Distance of the vessel from a needle between ``ends_mm`` (2, 3), the tip last."""
    vessel_from_axis = state.bodies[VESSEL].inverse() @ world_from_axis
    first, last = vessel_from_axis.apply(ends_mm)
    radius = NEEDLE.diameter_mm / 2.0
    inwards = radius * (last - first) / np.linalg.norm(last - first)
    return judge.clearance(first + inwards, last - inwards, radius)


@cache
def operation() -> Operation:
    """The operation, planned once in a process."""
    return Operation()
