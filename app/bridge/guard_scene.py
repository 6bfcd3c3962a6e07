"""Surfaces, poses and arm's base of a running guard, and proofs of paths beside its obstacles."""

import math
import threading
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeVar

import numpy as np

from app.bridge.displays.session_client import SessionClient
from app.bridge.node import RosNode
from app.bridge.obstacles import Obstacles
from app.bridge.plan_execution import WAIT_S
from app.bridge.ros_errors import BridgeError
from app.control import ControlDescription, Plan
from app.geometry import (
    FloatArray,
    FrameError,
    InputError,
    MarginGuardError,
    Stamp,
    SurfaceMesh,
    Transform,
)
from app.planning import prove_path
from app.runtime import SessionContent
from app.session import StepResult

_Value = TypeVar("_Value")


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
        return scene, self.obstacles_at(scene, step)[0]

    def obstacles_at(self, scene: Scene, step: StepResult) -> tuple[dict[str, SurfaceMesh], bool]:
        """The obstacles in the arm's root link, and True if none is in a frame that moves."""
        found, is_still = {}, True
        root_from_frame = scene.frame_from_root.inverse()
        for name, surface in self.obstacles.current():
            pose = Transform.identity(root_from_frame.target, surface.frame)
            if surface.frame != root_from_frame.target:  # which the guard may not have registered
                between, stamp = _pose(name, surface, root_from_frame.source, step)
                pose, is_still = root_from_frame @ between, is_still and stamp is None
            found[f"obstacle {name}"] = surface.transformed(pose)
        return found, is_still

    def obstacles_in(self, frame: str, step: StepResult) -> dict[str, SurfaceMesh]:
        """The obstacles in ``frame``. Raises `FrameError` for one in an unknown frame."""
        return {
            f"obstacle {name}": surface.transformed(_pose(name, surface, frame, step)[0])
            for name, surface in self.obstacles.current()
        }

    def read(self, use: Callable[[SessionContent, StepResult], _Value]) -> _Value:
        """``use(content, step)`` of the guard's first step for which it raises no `FrameError`.

        A step whose margin is UNKNOWN is not used: its poses may be wrong. Raises the last error
        after `WAIT_S`, and `BridgeError` without a guard.
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
                        if time.monotonic() - begin_s > WAIT_S:
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


def _pose(
    name: str, surface: SurfaceMesh, frame: str, step: StepResult
) -> tuple[Transform, Stamp | None]:
    try:
        return step.edges.between(frame, surface.frame)
    except FrameError as error:
        raise FrameError(f"obstacle {name!r}: {error}; expected a known frame") from error


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
        self._proven, self._is_testing, self._problem = -1, False, ""
        self._read: tuple[Scene, StepResult] | None = None

    def __call__(self, positions: FloatArray | None, progress: float) -> str | None:
        """Empty while the rest of the path is proven, None while that is being tested.

        Otherwise the reason for which the motion has to stop. ``positions`` (n,) of all joints are
        on the path, None at its start; ``progress`` is the share of the planned time before them.
        Does not block.
        """
        revision = self._guard.obstacles.revision
        if self._problem or revision == self._proven:
            return self._problem
        if not self._is_testing:
            self._is_testing = True
            states = self._rest(positions, progress)
            threading.Thread(
                target=self._prove, args=(revision, states), name="path proof", daemon=True
            ).start()
        return None

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
            carried, obstacles = self._bodies()
            prove_path(
                self._robot,
                self._motion.joints,
                self._motion.held,
                states,
                obstacles,
                clearance_mm=self._clearance_mm,
                carried=carried,
            )
            self._proven = revision
        except MarginGuardError as error:
            self._problem = str(error)
        except Exception as error:  # the motion has to stop
            self._problem = f"obstacles: the proof failed ({type(error).__name__}: {error})"
        finally:
            self._is_testing = False

    def _bodies(self) -> tuple[Mapping[str, SurfaceMesh], dict[str, SurfaceMesh]]:
        """Carried bodies and obstacles.

        The guard is read before the start, so that in mid-motion the proof delays no commands; and
        again for an obstacle in a frame that moves.
        """
        if self._read is not None:
            obstacles, are_still = self._guard.obstacles_at(*self._read)
            if are_still:
                return self._read[0].carried, obstacles

        def use(
            content: SessionContent, step: StepResult
        ) -> tuple[Scene, StepResult, dict[str, SurfaceMesh]]:
            scene = self._guard.scene(content, step)
            return scene, step, self._guard.obstacles_at(scene, step)[0]

        scene, step, obstacles = self._guard.read(use)
        self._read = scene, step
        return scene.carried, obstacles
