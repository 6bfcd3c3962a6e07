"""Preview of an approach for displays: places of all bodies, and distances."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.geometry import NS_PER_S, FloatArray, SurfaceMesh
from app.planning.approach import Approach
from app.planning.collision import CollisionModel
from app.planning.path_timing import shown_samples
from app.robot import Robot


@dataclass(frozen=True, slots=True, eq=False)
class ApproachPreview:
    """``approach`` at k times, start and end among them.

    ``moving`` are the collision surfaces of links and carried bodies, with ``poses`` (k, b, 4, 4)
    in the root link in mm; ``structures`` stand there. ``distances_mm`` (k, s) are the structures'
    from the nearest moving body, NaN where none is tested. ``samples`` (k,) are the numbers of the
    approach's samples.
    """

    approach: Approach
    samples: NDArray[np.intp]
    moving: tuple[tuple[str, SurfaceMesh], ...]
    structures: tuple[tuple[str, SurfaceMesh], ...]
    poses: FloatArray
    distances_mm: FloatArray

    @property
    def times_s(self) -> FloatArray:
        """The times (k,)."""
        return np.asarray(self.approach.times_ns[self.samples] / NS_PER_S)

    @property
    def via_states(self) -> int:
        """Number of states between start and end at which the robot stops."""
        return max(int((~self.approach.velocities.any(axis=1)).sum()) - 2, 0)

    @property
    def nearest(self) -> list[tuple[str, float]]:
        """The result of `nearest_structures`, from all distances."""
        if not np.isfinite(self.distances_mm).any():
            return []
        nearest = np.nanargmin(self.distances_mm, axis=1).tolist()
        return [
            (self.structures[number][0], float(row[number]))
            for number, row in zip(nearest, self.distances_mm, strict=True)
        ]


def nearest_structures(
    robot: Robot,
    approach: Approach,
    structures: Mapping[str, SurfaceMesh],
    carried: Mapping[str, SurfaceMesh],
) -> list[tuple[str, float]]:
    """The structure nearest to the robot at each of `shown_samples`, and its distance in mm.

    Empty if no structure is tested.
    """
    model = _model(robot, approach, structures, carried)
    states = approach.positions[shown_samples(len(approach.times_ns))]
    return [nearest for nearest in map(model.nearest_structure, states) if nearest is not None]


def preview_approach(
    robot: Robot,
    approach: Approach,
    structures: Mapping[str, SurfaceMesh],
    carried: Mapping[str, SurfaceMesh],
) -> ApproachPreview:
    """Evaluate ``approach`` at its `shown_samples`; the bodies are those of `plan_approach`."""
    model = _model(robot, approach, structures, carried)
    samples = shown_samples(len(approach.times_ns))
    poses, distances = [], []
    for state in approach.positions[samples]:
        named = {**approach.held, **dict(zip(approach.joints, state.tolist(), strict=True))}
        links = robot.forward_kinematics(named)
        poses.append([links[body.link].matrix for body in model.moving])
        distances.append(model.distances_mm(state))
    return ApproachPreview(
        approach,
        samples,
        tuple((body.name, body.mesh) for body in model.moving),
        tuple((body.name, body.mesh) for body in model.structures),
        np.array(poses),
        np.array(distances),
    )


def _model(
    robot: Robot,
    approach: Approach,
    structures: Mapping[str, SurfaceMesh],
    carried: Mapping[str, SurfaceMesh],
) -> CollisionModel:
    return CollisionModel(
        robot,
        approach.joints,
        approach.held,
        structures,
        clearance_mm=approach.clearance_mm,
        carried=carried,
    )
