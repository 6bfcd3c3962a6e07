"""Robots among random structures, and a check of their motions by coal at fine steps."""

import importlib.metadata
from itertools import combinations, pairwise
from pathlib import Path

import coal
import numpy as np
import trimesh

from app.geometry import SurfaceMesh
from app.planning import CollisionModel, MotionLimits
from app.planning.collision_bodies import arm
from app.robot import load_robot
from app.robot.link_kernel import compute_link_poses
from benchmarks.fixture.engines import coal_model
from tests.tiers import PROJECT_ROOT

LINKS = {"touch": "stylus", "ur5": "tool0", "panda": "panda_hand_tcp"}
"""Robot -> the link of its tool. The arm of the simulated world `data/worlds` is the first."""

ADJACENT = {
    "touch": [("touch_base", "torso"), ("torso", "upper_arm"), ("upper_arm", "forearm"),
              ("forearm", "wrist"), ("wrist", "gimbal"), ("gimbal", "stylus"), ("wrist", "stylus")],
    "ur5": [("base_link", "shoulder_link"), ("shoulder_link", "upper_arm_link"),
            ("upper_arm_link", "forearm_link"), ("forearm_link", "wrist_1_link"),
            ("wrist_1_link", "wrist_2_link"), ("wrist_2_link", "wrist_3_link"),
            ("wrist_3_link", "ee_link")],
    "panda": [*((f"panda_link{k}", f"panda_link{k + 1}") for k in range(7)),
              ("panda_link7", "panda_hand"), ("panda_hand", "panda_leftfinger"),
              ("panda_hand", "panda_rightfinger")],
}  # fmt: skip
"""Robot -> pairs that are not tested: one follows the other, or they always touch (the last)."""

STEP_MM = 0.1
"""The fastest point of the robot moves by this between two checked states."""


def load(name):
    """The robot ``touch``, ``ur5`` or ``panda``."""
    if name == "touch":
        return load_robot(PROJECT_ROOT / "data" / "robots" / "touch" / "touch.urdf")
    files = importlib.metadata.files("example-robot-data") or []
    (path,) = (
        Path(str(f.locate())) for f in files if f.name in (f"{name}_robot.urdf", f"{name}.urdf")
    )
    return load_robot(path)


def arm_joints(robot):
    """The joints of the arm, without those of the gripper."""
    return tuple(name for name in robot.actuated_joint_names if not robot.tree.joint(name).slides)


def limits_of(robot):
    """The same acceleration and jerk for all joints."""
    return {name: MotionLimits(5.0, 50.0) for name in robot.actuated_joint_names}


def random_state(robot, rng):
    """Positions of all actuated joints, within half a turn; a gripper is open."""
    joints = [robot.tree.joint(name) for name in robot.actuated_joint_names]
    return {
        joint.name: joint.upper
        if joint.slides
        else float(rng.uniform(max(joint.lower, -np.pi), min(joint.upper, np.pi)))
        for joint in joints
    }


def random_structures(robot, rng, count=10):
    """Balls, boxes and cylinders within the reach of the robot, 15 % of it in size."""
    tool = LINKS[robot.name]
    points = [robot.forward_kinematics(random_state(robot, rng))[tool] for _ in range(200)]
    points = np.array([pose.translation_mm for pose in points])
    reach = np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    made = {}
    while len(made) < count:
        size = reach * rng.uniform(0.06, 0.15, size=3)
        shape = (
            trimesh.creation.icosphere(3),
            trimesh.creation.box((1.6, 1.6, 1.6)),
            trimesh.creation.cylinder(1.0, 2.0, sections=48),
        )[len(made) % 3]
        turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
        center = points[rng.integers(len(points))]
        vertices = (shape.vertices * size) @ turn.T + center
        made[f"structure_{len(made)}"] = SurfaceMesh(robot.root_link, vertices, shape.faces)
    return made


def random_queries(robot, rng, clearance_mm):
    """Random structures, pairs of a free start of all joints and a free goal, and their model.

    A scene that leaves few states free, such as one with a structure in the base, is drawn again.
    """
    joints = arm_joints(robot)
    while True:
        structures = random_structures(robot, rng)
        states = [random_state(robot, rng) for _ in range(40)]
        held = {name: value for name, value in states[0].items() if name not in joints}
        model = CollisionModel(
            robot, joints, held, structures, clearance_mm=clearance_mm, carried={}
        )
        free = [
            state
            for state in states
            if model.contact_at(np.array([state[name] for name in joints])) is None
        ]
        if len(free) >= 10:
            goals = [{name: state[name] for name in joints} for state in free[5:10]]
            return structures, list(zip(free[:5], goals, strict=True)), model


def random_problem(robot, rng, clearance_mm):
    """Random structures, a free start of all joints, a free goal of the arm's, and their model."""
    structures, queries, model = random_queries(robot, rng, clearance_mm)
    return structures, *queries[0], model


class CoalScene:
    """The surfaces of a robot and of structures as models of coal."""

    def __init__(self, robot, structures, step_mm=STEP_MM):
        self.robot, self.step_mm = robot, step_mm
        links = {
            link.name: trimesh.util.concatenate(
                [trimesh.Trimesh(s.mesh.vertices_mm, s.mesh.faces) for s in link.collisions]
            )
            for link in robot.links
            if link.collisions
        }
        self.models = {name: coal_model(mesh.vertices, mesh.faces) for name, mesh in links.items()}
        self.corners = {name: trimesh.bounds.corners(mesh.bounds) for name, mesh in links.items()}
        self.structures = {
            name: coal_model(mesh.vertices_mm, mesh.faces) for name, mesh in structures.items()
        }
        self.request, self.result = coal.DistanceRequest(), coal.DistanceResult()

    def distance_mm(self, first, at, second, other_at):
        """The distance of two models at poses; at most 0 if they intersect."""
        self.result.clear()
        return coal.distance(first, at, second, other_at, self.request, self.result)

    def closest_mm(self, trajectory, held, joints, clearance_mm):
        """The smallest excess of a distance over the clearance, and the pair, on a trajectory.

        ``trajectory`` (n, d) are joint positions, joined by straight lines, which are checked at
        steps of `STEP_MM`. A pair is left out for as long as the path lengths of the corners of the
        links' boxes show that its last distance cannot have been used up.
        """
        matrices = self._poses(trajectory, held, joints)
        rows = self.robot.tree.link_rows
        names = sorted(self.models)
        moved = {}
        for name in names:
            m = matrices[:, rows[name]]
            points = np.einsum("nij,kj->nki", m[:, :3, :3], self.corners[name]) + m[:, None, :3, 3]
            steps = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1)
            moved[name] = np.concatenate([[0.0], np.cumsum(steps)])
        worst = (np.inf, None)
        still = coal.Transform3s()

        def pose(name, k):
            m = matrices[k, rows[name]]
            return coal.Transform3s(m[:3, :3].copy(), m[:3, 3].copy())

        def follow(pair, path, clearance, at):
            nonlocal worst
            k = 0
            while k < len(matrices):
                excess = at(k) - clearance
                if excess < worst[0]:
                    worst = (excess, pair)
                k = max(k + 1, int(np.searchsorted(path, path[k] + excess, side="right")))

        for name in names:
            if moved[name][-1] == 0.0:
                continue
            for structure, model in self.structures.items():
                follow(
                    (name, structure),
                    moved[name],
                    clearance_mm,
                    lambda k, n=name, m=model: self.distance_mm(
                        self.models[n], pose(n, k), m, still
                    ),
                )
        for a, b in combinations(names, 2):
            if (a, b) in ADJACENT[self.robot.name] or (b, a) in ADJACENT[self.robot.name]:
                continue
            follow(
                (a, b),
                moved[a] + moved[b],
                0.0,
                lambda k, a=a, b=b: self.distance_mm(
                    self.models[a], pose(a, k), self.models[b], pose(b, k)
                ),
            )
        return worst

    def _poses(self, trajectory, held, joints):
        """Poses (n, links, 4, 4) at steps of `STEP_MM` of the fastest corner."""
        tree, of_arm = self.robot.tree, arm(self.robot, joints, held)
        gains = np.where(of_arm.driver == np.arange(len(joints))[:, None], of_arm.gain, 0.0)

        def at(states):
            values = of_arm.base + states @ gains
            matrices = np.empty((*values.shape[:-1], values.shape[-1] + 1, 4, 4))
            for each, made in zip(values, matrices, strict=True):
                compute_link_poses(
                    each, of_arm.slides, of_arm.origins, of_arm.motions, of_arm.parents, made
                )
            return matrices

        rows = [tree.link_rows[name] for name in sorted(self.models)]
        corners = np.array([self.corners[name] for name in sorted(self.models)])
        parts = [at(trajectory[:1])]
        for start, end in pairwise(trajectory):
            m = at(np.linspace(start, end, 9))[:, rows]
            places = np.einsum("lnij,nkj->lnki", m[..., :3, :3], corners) + m[..., None, :3, 3]
            longest = np.linalg.norm(np.diff(places, axis=0), axis=3).max(axis=(1, 2)).sum()
            count = max(1, int(np.ceil(longest / self.step_mm)))
            parts.append(at(np.linspace(start, end, count + 1)[1:]))
        return np.concatenate(parts)
