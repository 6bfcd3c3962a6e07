"""A hand pushes a tool at a tumour beside a vessel, with a session as guard and a controller."""

from functools import lru_cache
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from app.case import TrackingFrame
from app.fixture import FixtureDecision, FixtureRule, MarginParameters, Proximity, ProximityEngine
from app.geometry import Stamp, TrackedTransform, TrackingStatus, Transform
from app.session import Role, Session, SessionSetup, Structure
from tests.fixture.control.guarded_loop import Conditions, Guard, Scene, simulate, tool, tumor

STOP_MM, LOSS_MM = 1.0, 0.1
STEPS = 220


def vessel(rng: np.random.Generator, reach_mm: float) -> trimesh.Trimesh:
    """A tube of 4 mm in a random direction, 0.5 to 4 mm beside a ball of ``reach_mm``."""
    made = trimesh.creation.cylinder(2.0, 80.0, sections=24)
    made.apply_translation([reach_mm + 2.0 + rng.uniform(0.5, 4.0), 0.0, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    return made.apply_transform(pose)


class Nearest:
    """The true distance to the nearer of two bodies."""

    def __init__(self, engines: list[ProximityEngine]) -> None:
        self._engines = engines

    def evaluate(self, pose: Transform) -> Proximity:
        """The proximity to the nearer one."""
        found = [each.evaluate(pose.renamed(target=each.frames[0])) for each in self._engines]
        return min(found, key=lambda each: each.signed_distance_mm)


class Pair(Scene):
    """A tumour with a vessel beside it."""

    def __init__(self, target: trimesh.Trimesh, beside: trimesh.Trimesh, tool: trimesh.Trimesh):
        super().__init__(target, tool)
        self.vessel = Scene(beside, tool, name="vessel")
        self.truth = Nearest([self.truth, self.vessel.truth])

    def judged_mm(self, pose: Transform) -> float:
        """The distance to the nearer one by libigl."""
        return min(super().judged_mm(pose), self.vessel.judged_mm(pose))


class SessionGuard(Guard):
    """A whole session with two structures on different frames, beside the poses of a tracker."""

    scene: Pair

    def __post_init__(self) -> None:
        super().__post_init__()
        self._session = Session(session_setup(self.scene, self.margins), free_motion=True)
        self._rng = np.random.default_rng(0)

    def measure(self, pose: Transform, now_ns: int) -> None:
        """The tracker measures the tool, and both other sensors with a jitter of 1 um."""
        stamp, arrived = Stamp(now_ns), Stamp(now_ns + self.latency_ns)
        rotation, place_mm = pose.rotation, pose.translation_mm
        poses = [Transform("tracker", "cautery", rotation, place_mm)]
        for name in ("needle", "reference"):
            jitter_mm = self._rng.normal(scale=1e-3, size=3)
            poses.append(Transform("tracker", name, np.eye(3), jitter_mm))
        samples = tuple(TrackedTransform(each, stamp, TrackingStatus.OK) for each in poses)
        self._waiting.append((TrackingFrame(arrived, samples), arrived, stamp))

    def decide(self, observed: Any) -> FixtureDecision:
        """The decision of the session on a frame."""
        return self._session.step(observed).decision


def session_setup(scene: Pair, margins: MarginParameters) -> SessionSetup:
    """The tumour on the needle, the vessel on the reference."""
    return SessionSetup(
        tool_from_tip=Transform.identity("cautery", "tool"),
        frame_from_tumor=Transform.identity("needle", "tumor"),
        proximity=scene.engine,
        margins=margins,
        robot=None,
        structures=(
            Structure(
                Transform.identity("reference", "vessel"),
                scene.vessel.engine,
                STOP_MM,
                STOP_MM + 4.0,
                role=Role.FORBIDDEN,
            ),
        ),
    )


@lru_cache(1)
def world(seed: int, cautery: trimesh.Trimesh) -> tuple[Pair, Conditions]:
    """Bodies, tool and hand of one push."""
    rng = np.random.default_rng(seed)
    target = tumor(("convex", "lobed", "hollow")[seed % 3], rng)
    reach_mm = float(np.linalg.norm(target.vertices, axis=1).max())
    shape = tool(("cautery", "needle")[seed % 2], cautery)
    scene = Pair(target, vessel(rng, reach_mm), shape)
    hand = ("push", "slide", "turn", "any")[seed % 4]
    return scene, Conditions(int(rng.integers(40)), 25, 0.01, hand, rng.uniform(20.0, 120.0))


def push(seed: int, cautery: trimesh.Trimesh, guard_type: type[Guard] = SessionGuard) -> float:
    """The lowest distance in mm to tumour and vessel of one push, by libigl.

    The pose is the lowest one of all control steps by exact distances.
    """
    scene, conditions = world(seed, cautery)
    found = simulate(
        scene,
        FixtureRule(),
        seed,
        steps=STEPS,
        stop_mm=STOP_MM,
        v_max_mm_s=50.0,
        conditions=conditions,
        guard_type=guard_type,
    )
    assert found.pose is not None
    assert found.way_mm > 1.0
    return min(found.lowest_mm, scene.judged_mm(found.pose))
