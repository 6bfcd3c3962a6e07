"""Proof of the rest of a path against the obstacles of other nodes, again at each change."""

import math
import threading
from collections.abc import Mapping

import numpy as np

from app.bridge.guard_scene import GuardScene, Scene
from app.control import ControlDescription, Plan
from app.geometry import FloatArray, InputError, MarginGuardError, SurfaceMesh
from app.planning import prove_path
from app.runtime import SessionContent
from app.session import StepResult


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
