"""Compare proven motions with OMPL's sampled checks by FCL, on the same random queries.

``python -m tests.planning.compare_with_fcl --robots touch,ur5,panda --queries 100``

Both search with OMPL's RRTConnect, from the same start to the same goal among 10 structures. FCL
checks collisions (a clearance of 0) at states that are ``--resolution`` of the extent of the joint
space apart, structures in a DynamicAABBTreeCollisionManager. We prove ``--clearance-mm``, so the
report also says how many paths of FCL keep that. The times are processor times of the search alone,
without the shortcuts; the models are made before. Some paths of FCL collide between its samples.
Every path is checked by coal at steps of 0.1 mm.
"""

import argparse
import time
from functools import partial
from itertools import combinations

import fcl
import numpy as np
from ompl import base, geometric

from app.planning.path_search import find_path
from benchmarks.fixture.engines import fcl_object
from tests.planning.approach_scenes import ADJACENT, CoalScene, load, random_queries


class FclModel:
    """Collisions of a robot with structures and itself, at one state."""

    def __init__(self, robot, joints, held, structures, coal_scene):
        self.robot, self.joints, self.held = robot, joints, held
        self.links = {name: fcl_object(*_mesh_of(robot, name)) for name in coal_scene.models}
        self.structures = fcl.DynamicAABBTreeCollisionManager()
        self.structures.registerObjects(
            [fcl_object(mesh.vertices_mm, mesh.faces) for mesh in structures.values()]
        )
        self.structures.setup()
        still = {name for name in self.links if not robot.tree.joints_that_move(name) & set(joints)}
        self.moving = [self.links[name] for name in self.links if name not in still]
        ignored = {frozenset(pair) for pair in ADJACENT[robot.name]}
        self.pairs = [
            (self.links[a], self.links[b])
            for a, b in combinations(self.links, 2)
            if frozenset((a, b)) not in ignored
            and robot.tree.joints_that_move(a) & set(joints)
            != robot.tree.joints_that_move(b) & set(joints)
        ]
        self.rows = [robot.tree.link_rows[name] for name in self.links]
        self.request = fcl.CollisionRequest()

    def is_free(self, state):
        """True if nothing collides."""
        named = {**self.held, **dict(zip(self.joints, state, strict=True))}
        matrices = self.robot.tree.link_matrices(self.robot.complete_positions(named))
        for each, row in zip(self.links.values(), self.rows, strict=True):
            each.setTransform(fcl.Transform(matrices[row, :3, :3], matrices[row, :3, 3]))
        for each in self.moving:
            data = fcl.CollisionData()
            self.structures.collide(each, data, fcl.defaultCollisionCallback)
            if data.result.is_collision:
                return False
        return not any(
            fcl.collide(a, b, self.request, fcl.CollisionResult()) for a, b in self.pairs
        )


def _mesh_of(robot, name):
    (link,) = (link for link in robot.links if link.name == name)
    meshes = [shape.mesh for shape in link.collisions]
    offsets = np.cumsum([0, *(len(mesh.vertices_mm) for mesh in meshes[:-1])])
    faces = [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=True)]
    return np.concatenate([mesh.vertices_mm for mesh in meshes]), np.concatenate(faces)


def sampled_path(model, start, goal, limits, resolution, is_over):
    """The path (k, d) that RRTConnect finds with sampled checks, or None."""
    count = len(start)
    bounds = base.RealVectorBounds(count)
    for joint in range(count):
        bounds.setLow(joint, float(limits[0][joint]))
        bounds.setHigh(joint, float(limits[1][joint]))
    states = base.RealVectorStateSpace(count)
    states.setBounds(bounds)
    space = base.SpaceInformation(states)
    space.setStateValidityChecker(
        lambda state: model.is_free([state[joint] for joint in range(count)])
    )
    space.setStateValidityCheckingResolution(resolution)
    space.setup()
    ends = [states.allocState(), states.allocState()]
    for end, positions in zip(ends, (start, goal), strict=True):
        for joint in range(count):
            end[joint] = float(positions[joint])
    if space.checkMotion(*ends):
        return np.array([start, goal])
    problem = base.ProblemDefinition(space)
    problem.setStartAndGoalStates(*ends)
    planner = geometric.RRTConnect(space)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(is_over))
    if not problem.hasExactSolution():
        return None
    path = problem.getSolutionPath().getStates()
    return np.array([[state[joint] for joint in range(count)] for state in path])


def compare(name, queries, resolutions, allowed_s, seed, clearance_mm):
    """Compare one robot, with a report every 100 queries."""
    robot, rng = load(name), np.random.default_rng(seed)
    rows = {label: [] for label in ("proven", *(f"FCL {each:g}" for each in resolutions))}
    for scene in range(1, queries // 5 + 1):
        structures, pairs, model = random_queries(robot, rng, clearance_mm)
        joints = model.joints
        held = {joint: value for joint, value in pairs[0][0].items() if joint not in joints}
        coal_scene = CoalScene(robot, structures)
        fcl_model = FclModel(robot, joints, held, structures, coal_scene)
        limits = tuple(
            np.array([getattr(robot.tree.joint(joint), side) for joint in joints])
            for side in ("lower", "upper")
        )
        for pair in pairs:
            start, goal = (np.array([each[joint] for joint in joints]) for each in pair)
            searches = {"proven": partial(find_path, model, start, goal[None], limits)}
            for each in resolutions:
                searches[f"FCL {each:g}"] = partial(
                    sampled_path, fcl_model, start, goal, limits, each
                )
            for label, search in searches.items():
                begin = time.process_time()
                path = search(lambda begin=begin: time.process_time() - begin > allowed_s)
                spent_s = time.process_time() - begin
                nearest_mm = [
                    np.nan if path is None else coal_scene.closest_mm(path, held, joints, each)[0]
                    for each in (0.0, clearance_mm)
                ]
                rows[label].append((path is not None, *nearest_mm, spent_s))
        if scene % 20 == 0 or scene == queries // 5:
            report(name, rows)


def report(name, rows):
    """Print success and times of the queries until now."""
    for label, values in rows.items():
        found, gap_mm, excess_mm, spent_s = map(np.array, zip(*values, strict=True))
        keeps = found & (excess_mm > -1e-6)
        valid = keeps if label == "proven" else found & (gap_mm > 0.0)
        p50, p95 = np.percentile(np.where(valid, spent_s, np.inf), (50, 95), method="lower")
        print(
            f"{name:6} {label:10} {valid.sum():4} of {len(found)} valid, "
            f"{(found & ~valid).sum():3} not, {keeps.sum():4} keep the clearance, "
            f"p50 {p50 * 1e3:8.1f} ms, p95 {p95 * 1e3:8.1f} ms, sum {spent_s.sum():7.2f} s",
            flush=True,
        )


def main():
    """Run the comparison."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", default="touch,ur5,panda")
    parser.add_argument("--queries", type=int, default=100)
    parser.add_argument("--resolution", type=float, action="append")
    parser.add_argument("--allowed-s", type=float, default=3.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--clearance-mm", type=float, default=1.0)
    options = parser.parse_args()
    for name in options.robots.split(","):
        compare(
            name,
            options.queries,
            options.resolution or [0.01, 0.001],
            options.allowed_s,
            options.seed,
            options.clearance_mm,
        )


if __name__ == "__main__":
    main()
