"""Random scenes for needle corridors, and the judgement of a plan by an exhaustive search."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import trimesh

from app.geometry import FloatArray, InputError, SurfaceMesh
from app.planning import (
    EntryRegion,
    ForbiddenStructure,
    Needle,
    NeedlePlan,
    NeedleTarget,
    NoCorridorError,
    plan_needle,
)
from tests.oracles.needle_oracle import NeedleOracle

FRAME = "patient"
ENTRIES, GRID = 20_000, 1000
"""Entries of the planner, and of the exhaustive search at other places."""


def blob(
    rng: np.random.Generator, center: FloatArray, radius: float, level: int = 2
) -> SurfaceMesh:
    """A closed surface of random shape, star-shaped from ``center``."""
    ball = trimesh.creation.icosphere(level, 1.0)
    waves = np.sin(ball.vertices @ rng.normal(scale=2.0, size=(3, 4)) + rng.uniform(0, 6, 4))
    lengths = radius * (1.0 + waves @ rng.uniform(0.0, 0.12, 4))
    stretch = rng.uniform(0.5, 1.5, 3)
    return SurfaceMesh(FRAME, center + ball.vertices * lengths[:, None] * stretch, ball.faces)


@dataclass(frozen=True, eq=False)
class Scene:
    """A skin above forbidden structures above a target point; all numbers are random."""

    skin: SurfaceMesh
    target: FloatArray
    needle: Needle
    structures: tuple[ForbiddenStructure, ...]
    sigma_mm: float
    k_sigma: float

    @classmethod
    def random(cls, seed: int) -> "Scene":
        rng = np.random.default_rng(seed)
        ball = trimesh.creation.icosphere(3, rng.uniform(60.0, 120.0))
        top = ball.vertices[:, 2].max()
        cap = ball.faces[(ball.vertices[ball.faces, 2] > rng.uniform(0.7, 0.95) * top).all(axis=1)]
        target = np.append(rng.uniform(-15.0, 15.0, 2), top - rng.uniform(40.0, 70.0))
        structures = tuple(
            ForbiddenStructure(
                f"structure {number}",
                blob(
                    rng,
                    target + np.append(rng.uniform(-30.0, 30.0, 2), rng.uniform(10.0, 40.0)),
                    rng.uniform(3.0, 18.0),
                ),
                rng.uniform(0.0, 3.0),
                rng.choice([0.0, 0.5]),
            )
            for number in range(rng.integers(1, 10))
        )
        needle = Needle(rng.uniform(60.0, 120.0), rng.uniform(0.5, 2.0), rng.uniform(0.0, 3.0))
        skin = SurfaceMesh(FRAME, ball.vertices, cap)
        return cls(skin, target, needle, structures, rng.uniform(0.0, 1.5), 2.0)

    def plan(self) -> NeedlePlan | None:
        """The plan; None if no corridor is allowed."""
        try:
            return plan_needle(
                EntryRegion.of_surface(self.skin, count=ENTRIES),
                NeedleTarget.of_points(FRAME, [self.target]),
                self.needle,
                self.structures,
                error=self.sigma_mm,
                k_sigma=self.k_sigma,
            )
        except (NoCorridorError, InputError):  # InputError: beyond the length of the needle
            return None


class Judge:
    """Scores entries of a scene with the oracle, by the formulas of ``docs/planning.md``."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._oracles = [NeedleOracle(each.surface) for each in scene.structures]
        self._in_structure = any(each.contains(scene.target) for each in self._oracles)

    def reserve(self, entry: FloatArray) -> float:
        """Least distance beyond the required one; negative where the corridor is not allowed."""
        scene = self._scene
        if self._in_structure:
            return -math.inf
        depth = float(np.linalg.norm(scene.target - entry))
        radius = (
            scene.needle.diameter_mm / 2
            + scene.needle.bend_mm * (depth / scene.needle.length_mm) ** 2
        )
        return min(
            oracle.clearance(entry, scene.target, radius)
            - each.stop_mm
            - scene.k_sigma * math.hypot(scene.sigma_mm, each.sigma_mm)
            for oracle, each in zip(self._oracles, scene.structures, strict=True)
        )

    def limits(self, entries: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Score (n,) without the rating of the distance; whether depth and angle are allowed."""
        inward = self._scene.target - entries
        depth = np.linalg.norm(inward, axis=1)
        angle = np.arccos(np.clip(-(inward * normals).sum(axis=1) / depth, -1.0, 1.0))
        length = self._scene.needle.length_mm
        base = 0.2 * (1.0 - angle / math.radians(60)) + 0.15 * (1.0 - depth / length) + 0.15
        return base, (depth <= length) & (angle <= math.radians(60))

    def best_score(self, entries: FloatArray, normals: FloatArray, at_least: float) -> float:
        """The highest score of all ``entries``, or ``at_least`` if none is higher."""
        base, allowed = self.limits(entries, normals)
        best = at_least
        for index in np.argsort(-base):
            # The distance is rated with at most 0.5.
            if base[index] + 0.5 <= best:
                break
            if allowed[index]:
                reserve = self.reserve(entries[index])
                if reserve >= 0.0:
                    best = max(best, float(base[index]) + 0.5 * min(reserve / 10.0, 1.0))
        return best


@dataclass(frozen=True)
class Verdict:
    """Violations of offered corridors and of the map, and best score over the exhaustive one."""

    corridors: int
    violations: int
    wrong_entries: int
    score_ratio: float


def judged(seed: int) -> Verdict:
    """Plan the scene ``seed`` and judge the plan."""
    scene, rng = Scene.random(seed), np.random.default_rng(seed + 10**6)
    plan, judge = scene.plan(), Judge(scene)
    entries, normals = random_points(rng, scene.skin)
    if plan is None:
        found = judge.best_score(entries[::10], normals[::10], 0.0)
        return Verdict(0, 0, 0, 1.0 if found == 0.0 else 0.0)
    violations = 0
    for each in plan.corridors:
        _, allowed = judge.limits(each.entry_mm[None], _normal_at(plan, each.entry_mm))
        violations += not allowed[0] or judge.reserve(each.entry_mm) < -1e-6
    wrong = 0
    for index in rng.choice(len(plan.scores), 40):
        if plan.blocked[index] in (0, 1):
            continue
        reserve = judge.reserve(plan.region.points_mm[index])
        wrong += abs(reserve) > 1e-6 and (reserve < 0.0) != np.isnan(plan.scores[index])
    best = judge.best_score(entries, normals, plan.best.score)
    return Verdict(len(plan.corridors), violations, wrong, plan.best.score / best)


def random_points(
    rng: np.random.Generator, skin: SurfaceMesh, count: int = GRID
) -> tuple[FloatArray, FloatArray]:
    """Places (n, 3) on the skin and the normals there, at random by area."""
    corners = skin.triangles_mm
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(crossed, axis=1)
    face = rng.choice(len(area), count, p=area / area.sum())
    u, v = rng.uniform(size=(2, count))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    weights = np.stack([1.0 - u - v, u, v], axis=1)
    points = np.einsum("ni,nij->nj", weights, corners[face])
    return points, crossed[face] / area[face, None]


def _normal_at(plan: NeedlePlan, entry: FloatArray) -> FloatArray:
    at = np.linalg.norm(plan.region.points_mm - entry, axis=1).argmin()
    return plan.region.normals[at][None]


def check_scenes(seeds: Iterable[int]) -> None:
    """Some scenes have corridors; none is too near, none is missed, and the best is the best."""
    verdicts = [judged(seed) for seed in seeds]
    assert sum(each.corridors for each in verdicts) > 0
    assert sum(each.violations for each in verdicts) == 0
    assert sum(each.wrong_entries for each in verdicts) == 0
    assert min(each.score_ratio for each in verdicts) >= 0.98
