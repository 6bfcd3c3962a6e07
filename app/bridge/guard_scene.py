"""Surfaces, poses and arm's base of a running guard, and proofs of paths beside its obstacles."""

import math
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import NamedTuple, TypeVar

import numpy as np

from app.bridge.displays.session_client import SessionClient
from app.bridge.node import RosNode
from app.bridge.obstacles import Obstacle, Obstacles
from app.bridge.plan_execution import WAIT_S
from app.bridge.ros_errors import BridgeError
from app.control import ControlDescription, Plan
from app.geometry import (
    FloatArray,
    FrameError,
    InputError,
    MarginGuardError,
    SurfaceMesh,
    Transform,
)
from app.planning import prove_path
from app.runtime import SessionContent
from app.session import StepResult

_Value = TypeVar("_Value")

_MAX_DEAD_MM = 1.0
"""Motion of an obstacle with its frame for which a path is not proven again."""

_LOOKS = 16
"""Most obstacles that are looked up in tf in one period, as 64 would take a whole one."""


class Scene(NamedTuple):
    """``structures`` in the arm's root link, by name; ``carried`` in the frames of links."""

    content: SessionContent
    frame_from_root: Transform
    structures: Mapping[str, SurfaceMesh]
    carried: Mapping[str, SurfaceMesh]

    @property
    def ids(self) -> dict[str, str]:
        """Ids of setup and registration."""
        return ids_of(self.content)


class PlacedObstacle(NamedTuple):
    """``pose`` is the obstacle's frame in the arm's root link.

    ``is_still`` is False for a pose that is another one at another step of the guard.
    """

    obstacle: Obstacle
    pose: Transform
    is_still: bool

    def surface(self) -> SurfaceMesh:
        """The surface in the root link."""
        return self.obstacle.surface.transformed(self.pose)


class GuardScene:
    """Reads the guard of ``description``, and the obstacles. Call it in a thread of its own."""

    def __init__(self, ros: RosNode, description: ControlDescription, obstacles: Obstacles) -> None:
        self.obstacles = obstacles
        self._domain_id = ros.node.context.get_domain_id()
        self._about, self._tool = description, description.tool

    def scene(self, content: SessionContent, step: StepResult) -> Scene:
        """The scene at ``step``. Raises `FrameError` while a pose is not known."""
        registration = content.registration
        base = self._about.frame_from_base if registration is None else registration.transform
        if base is None:
            raise BridgeError(
                "base of the arm: the guard has no registration, and control.yaml no base; "
                "expected one"
            )
        frame_from_root = base.renamed(source=self._tool.robot.root_link)
        root_from_frame = frame_from_root.inverse()
        poses = poses_of(content, step, frame_from_root.target)
        structures = {
            name: mesh.transformed(root_from_frame @ poses[name])
            for name, mesh in content.surfaces.items()
        }
        carried = {}
        if content.tool is not None:
            link_from_tool = self._tool.link_from_tip.renamed(source=content.tool.frame)
            carried[content.tool_name or "tool"] = content.tool.transformed(link_from_tool)
        return Scene(content, frame_from_root, structures, carried)

    def scene_with_obstacles(
        self, content: SessionContent, step: StepResult
    ) -> tuple[Scene, dict[str, SurfaceMesh]]:
        """The scene, and the obstacles in the arm's root link."""
        scene = self.scene(content, step)
        placed = self.obstacles_at(scene, step)
        return scene, {name: each.surface() for name, each in placed.items()}

    def obstacles_at(self, scene: Scene, step: StepResult) -> dict[str, PlacedObstacle]:
        """The obstacles, by name."""
        return {
            f"obstacle {each.name}": self.placed(each, scene, step)
            for each in self.obstacles.current()
        }

    def placed(self, obstacle: Obstacle, scene: Scene, step: StepResult) -> PlacedObstacle:
        """Place ``obstacle`` in the arm's root link. Raises `FrameError` for an unknown frame."""
        source, frame_from_root = obstacle.surface.frame, scene.frame_from_root
        if source == frame_from_root.source:  # which the guard may not have registered
            return PlacedObstacle(obstacle, Transform.identity(source, source), True)
        between, is_still = self._pose(obstacle, frame_from_root.target, step)
        return PlacedObstacle(obstacle, frame_from_root.inverse() @ between, is_still)

    def _pose(self, obstacle: Obstacle, frame: str, step: StepResult) -> tuple[Transform, bool]:
        """``frame_from_obstacle``, and False if it is another one at another step."""
        source = obstacle.surface.frame
        if obstacle.follows_tf and source != frame:
            return self.obstacles.tf_pose(obstacle, frame), True
        try:
            pose, stamp = step.edges.between(frame, source)
        except FrameError as error:
            raise FrameError(
                f"obstacle {obstacle.name!r}: {error}; expected a known frame"
            ) from error
        return pose, stamp is None

    def obstacles_in(self, frame: str, step: StepResult) -> dict[str, SurfaceMesh]:
        """The obstacles in ``frame``. Raises `FrameError` for one in an unknown frame."""
        return {
            f"obstacle {each.name}": each.surface.transformed(self._pose(each, frame, step)[0])
            for each in self.obstacles.current()
        }

    def read(self, use: Callable[[SessionContent, StepResult], _Value]) -> _Value:
        """``use(content, step)`` of the guard's first step for which it raises no `FrameError`.

        A step whose margin is UNKNOWN is not used: its poses may be wrong. Raises the last error
        after a part of `WAIT_S`: an execution that waits for its start then has it. Raises
        `BridgeError` without a guard.
        """
        name = self._about.constraint_topic.rpartition("/")[0]
        begin_s = time.monotonic()

        def wait(waited_s: float) -> None:
            if waited_s > WAIT_S:
                raise BridgeError(f"guard {name}: no step in {WAIT_S:g} s; expected a running one")

        with RosNode("marginguard_plan_guard", domain_id=self._domain_id) as ros:
            client = SessionClient(ros, name, waiting=wait)
            try:
                for step in client.steps():
                    if client.operator is None:
                        continue
                    try:
                        if step.distrust:
                            raise FrameError(step.distrust)
                        return use(client.operator.content, step)
                    except FrameError:
                        if time.monotonic() - begin_s > 0.8 * WAIT_S:
                            raise
            finally:
                client.close()
        raise AssertionError("the steps do not end")


def poses_of(content: SessionContent, step: StepResult, frame: str) -> dict[str, Transform]:
    """Tumour and structures in ``frame``; raises `FrameError` while one is not known."""
    return {name: step.edges.between(frame, name)[0] for name in content.surfaces}


def ids_of(content: SessionContent) -> dict[str, str]:
    """Ids of setup and registration."""
    return {"setup_id": content.setup_id, "registration_id": content.registration_id}


class PathWatch:
    """Tests the motion of ``plan``, whose clearance is kept. For one motion.

    Raises `InputError` for a plan without a clearance.
    """

    def __init__(self, description: ControlDescription, guard: GuardScene, plan: Plan) -> None:
        self._robot, self._joints = description.tool.robot, description.tool.joints
        self._guard, self._motion = guard, plan.motion
        clearance_mm = plan.values.get("clearance_mm")
        if not isinstance(clearance_mm, int | float) or not 0.0 < clearance_mm < math.inf:
            raise InputError(f"plan: its clearance is {clearance_mm!r} mm; expected one above 0")
        self._clearance_mm = float(clearance_mm)
        self._proven, self._is_testing, self._problem, self._turn = -1, False, "", 0
        self._read: tuple[Scene, StepResult] | None = None
        self._dead_mm = min(_MAX_DEAD_MM, 0.5 * self._clearance_mm)
        self._following: list[tuple[Obstacle, FloatArray, FloatArray]] = []
        """Obstacles that follow tf, and the corners (8, 3) of their boxes in their own frames and,
        as the path is proven for, in the root link. No other point of them moves farther."""

    def __call__(self, positions: FloatArray | None, progress: float) -> str | None:
        """Empty while the rest of the path is proven, None while that is being tested.

        Otherwise the reason for which the motion has to stop. ``positions`` (n,) of all joints are
        on the path, None at its start; ``progress`` is the share of the planned time before them.
        Does not block.
        """
        revision = self._guard.obstacles.revision
        try:
            is_as_proven = revision == self._proven and not self._have_moved()
            if self._problem or (is_as_proven and not self._is_testing):
                return self._problem  # a test may be of an obstacle that is not looked at now
        except FrameError as error:
            self._problem = self._problem or str(error)
            return self._problem
        if not self._is_testing:
            self._is_testing = True
            states = self._rest(positions, progress)
            threading.Thread(
                target=self._prove, args=(revision, states), name="path proof", daemon=True
            ).start()
        return None

    def _have_moved(self) -> bool:
        """True if an obstacle has moved in tf since the proof. Raises as `Obstacles.tf_pose`.

        Looks at `_LOOKS` obstacles, at others the next time: at all 64 within 20 ms.
        """
        if self._read is None:
            return False
        poses: dict[str, Transform] = {}
        following, self._turn = self._following, self._turn + 1
        parts = math.ceil(len(following) / _LOOKS) or 1
        for obstacle, corners, proven in following[self._turn % parts :: parts]:
            frame = obstacle.surface.frame
            if frame not in poses:
                poses[frame] = self._guard.placed(obstacle, *self._read).pose
            moved = poses[frame].apply(corners) - proven
            if not (moved * moved).sum(axis=1).max() <= self._dead_mm**2:
                return True
        return False

    def _rest(self, positions: FloatArray | None, progress: float) -> FloatArray:
        """The states (k, d) that are ahead, the present one first."""
        motion = self._motion
        if positions is None:
            return motion.positions
        now = positions[[self._joints.index(name) for name in motion.joints]]
        ahead = motion.times_ns > progress * motion.times_ns[-1]
        return np.concatenate([now[None], motion.positions[ahead]])

    def _prove(self, revision: int, states: FloatArray) -> None:
        try:
            carried, placed = self._bodies()
            prove_path(
                self._robot,
                self._motion.joints,
                self._motion.held,
                states,
                {name: each.surface() for name, each in placed.items()},
                clearance_mm=self._clearance_mm,
                carried=carried,
            )
            following = [each for each in placed.values() if each.obstacle.follows_tf]
            corners = [each.obstacle.surface.box_corners_mm for each in following]
            self._following = [
                (each.obstacle, own, each.pose.apply(own))
                for each, own in zip(following, corners, strict=True)
            ]
            self._proven = revision
        except MarginGuardError as error:
            self._problem = str(error)
        except Exception as error:  # the motion has to stop
            self._problem = f"obstacles: the proof failed ({type(error).__name__}: {error})"
        finally:
            self._is_testing = False

    def _bodies(self) -> tuple[Mapping[str, SurfaceMesh], dict[str, PlacedObstacle]]:
        """Carried bodies and obstacles.

        The guard is read before the start, so that in mid-motion the proof delays no commands; and
        again for an obstacle in a frame that moves there, or is not known yet.
        """
        if self._read is not None:
            with suppress(FrameError):
                obstacles = self._guard.obstacles_at(*self._read)
                if all(each.is_still for each in obstacles.values()):
                    return self._read[0].carried, obstacles

        def use(
            content: SessionContent, step: StepResult
        ) -> tuple[Scene, StepResult, dict[str, PlacedObstacle]]:
            scene = self._guard.scene(content, step)
            return scene, step, self._guard.obstacles_at(scene, step)

        scene, step, obstacles = self._guard.read(use)
        self._read = scene, step
        return scene.carried, obstacles
