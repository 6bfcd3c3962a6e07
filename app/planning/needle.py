"""Straight corridors for a needle from the skin to a target, past forbidden structures.

A corridor is allowed if the needle reaches the target, enters at most `MAX_ANGLE_RAD` from the
skin's normal, and keeps from each forbidden structure the distance ``stop_mm + k sigma`` with
``sigma^2`` the largest variance of the needle's place plus that of the structure's surface: the
rule of the margin (``docs/conventions.md``). Allowed ones are rated as in Schumann et al. 2010 and
Essert et al. 2012, by a weighted sum of ratings from 0 to 1.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.fixture.surfaces.surface import Surface
from app.geometry import FloatArray, FrameError, InputError, MarginGuardError
from app.planning.corridor_distance import closed_surface, needle_distances
from app.planning.hit_probability import covariance_of, hit_probability
from app.planning.needle_places import EntryRegion, NeedleTarget
from app.planning.needle_reach import NeedleRobot
from app.planning.needle_values import (
    FREE_MM,
    MAX_ANGLE_RAD,
    WEIGHTS,
    Corridor,
    ForbiddenStructure,
    Needle,
    NeedlePlan,
    StructureDistance,
)

DISTINCT_MM = 10.0
"""Least distance between the entries of two corridors that are offered."""

OFFERED = 4
"""Largest number of corridors that are offered."""

_MIN_DEPTH_MM = 1.0
"""A corridor that is shorter has no direction to speak of."""


_OWN_OBSTACLES = ("the length of the needle", "the angle to the skin")


class NoCorridorError(MarginGuardError):
    """No corridor is allowed; the message names the structure that blocks most entries."""


class _Guarded(NamedTuple):
    """A forbidden structure, prepared for queries, and the distance that it requires."""

    structure: ForbiddenStructure
    surface: Surface
    required_mm: float


def plan_needle(
    region: EntryRegion,
    target: NeedleTarget,
    needle: Needle,
    structures: Sequence[ForbiddenStructure],
    *,
    error: float | FloatArray,
    k_sigma: float,
    robot: NeedleRobot | None = None,
) -> NeedlePlan:
    """Find the best corridor from ``region`` to ``target``, and up to three distinct others.

    ``error`` is that of the needle's place at the target: a covariance (3, 3) in mm2, or a standard
    deviation in mm along each axis. ``k_sigma`` standard deviations are kept in addition to the
    distance of each structure. With ``robot`` only corridors are offered along which it can insert
    the needle; the map does not depend on it. Raises `NoCorridorError` if none is allowed or
    reached, `InputError` for a target beyond the needle's length and for other values, `FrameError`
    for different frames, `MeshError` for a structure that bounds no solid.
    """
    if not (math.isfinite(k_sigma) and k_sigma >= 0.0):
        raise InputError(f"k_sigma: is {k_sigma}; expected 0 or more")
    frames = {"target": target.frame} | {each.name: each.surface.frame for each in structures}
    if robot is not None:
        frames["robot"] = robot.frame_from_root.target
    for what, frame in frames.items():
        if frame != region.frame:
            raise FrameError(f"{what}: is in {frame!r}; expected {region.frame!r} as the entries")
    covariance = covariance_of(error)
    variance = float(np.linalg.eigvalsh(covariance)[-1])
    guarded = [
        _Guarded(
            each,
            closed_surface(each.surface, f"the mesh of {each.name!r}"),
            each.stop_mm + k_sigma * math.sqrt(max(variance, 0.0) + each.sigma_mm**2),
        )
        for each in structures
    ]
    rated = [
        _rated(region, point, centrality, needle, guarded)
        for point, centrality in zip(target.points_mm, target.centrality, strict=True)
    ]
    of_targets = np.stack([np.where(np.isnan(scores), -1.0, scores) for scores, _ in rated])
    chosen = of_targets.argmax(axis=0)
    scores = of_targets.max(axis=0)
    scores[scores < 0.0] = math.nan
    scores.flags.writeable = False
    obstacles = (*_OWN_OBSTACLES, *(each.name for each in structures))
    blocked = np.where(np.isnan(scores), rated[0][1], -1)
    blocked.flags.writeable = False
    plan = NeedlePlan(region, (), scores, blocked, obstacles)
    if np.isnan(scores).all():
        raise _no_corridor(plan, target, needle)
    found: list[Corridor] = []
    tried: list[FloatArray] = []
    # A stable sort: of equal scores the first entry is taken.
    for entry in np.argsort(-scores, kind="stable")[: int(np.isfinite(scores).sum())]:
        point = region.points_mm[entry]
        if tried and np.linalg.norm(np.array(tried) - point, axis=1).min() < DISTINCT_MM:
            continue
        tried.append(point)
        goal = target.points_mm[chosen[entry]]
        joints = () if robot is None else robot.insertion(point, goal)
        if robot is not None and not joints:
            continue
        centrality = float(target.centrality[chosen[entry]])
        found.append(
            _corridor(
                point, region.normals[entry], goal, centrality, needle, guarded, covariance, joints
            )
        )
        if len(found) == OFFERED:
            break
    if not found:
        raise NoCorridorError(
            f"robot: reaches none of {len(tried)} allowed corridors, {DISTINCT_MM:g} mm apart at "
            "the skin; expected at least one"
        )
    return NeedlePlan(region, tuple(found), scores, blocked, obstacles)


def _rated(
    region: EntryRegion,
    target_mm: FloatArray,
    centrality: float,
    needle: Needle,
    guarded: Sequence[_Guarded],
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Scores (n,) of the corridors to a point, NaN where not allowed, and their obstacles (n,)."""
    depth, angle = _depth_and_angle(region.points_mm, region.normals, target_mm)
    blocked = np.full(len(depth), -1)
    blocked[angle > MAX_ANGLE_RAD] = 1
    blocked[depth > needle.length_mm] = 0
    open_entries = np.flatnonzero(blocked < 0)
    radius = needle.radius_at(depth[open_entries])
    reserve = np.full(len(open_entries), FREE_MM)
    worst = np.full(len(open_entries), -1)
    for number, (_, surface, required_mm) in enumerate(guarded):
        # Only distances that leave less than those before are needed, and no depths.
        limit = radius + required_mm + reserve
        near = np.flatnonzero(limit > 0.0)
        axis_mm = needle_distances(
            surface,
            region.points_mm[open_entries[near]],
            target_mm,
            limit[near],
            tolerance_mm=math.inf,
        )
        left = axis_mm - radius[near] - required_mm
        less = left < reserve[near]
        worst[near[less]] = number + len(_OWN_OBSTACLES)
        reserve[near[less]] = left[less]
    blocked[open_entries[reserve < 0.0]] = worst[reserve < 0.0]
    scores = np.full(len(depth), math.nan)
    allowed = open_entries[reserve >= 0.0]
    ratings = _ratings(
        reserve[reserve >= 0.0], angle[allowed], depth[allowed], centrality, needle.length_mm
    )
    scores[allowed] = _score(ratings)
    return scores, blocked


def _depth_and_angle(
    points_mm: FloatArray, normals: FloatArray, target_mm: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Depth and angle to the inward normal, (n,) each; a corridor that is too short is at pi."""
    inward = target_mm - points_mm
    depth = np.linalg.norm(inward, axis=1)
    cosine = -np.einsum("ij,ij->i", inward, normals) / np.maximum(depth, _MIN_DEPTH_MM)
    return depth, np.where(depth < _MIN_DEPTH_MM, math.pi, np.arccos(np.clip(cosine, -1.0, 1.0)))


def _ratings(
    reserve_mm: FloatArray,
    angle_rad: FloatArray,
    depth_mm: FloatArray,
    centrality: float,
    length_mm: float,
) -> dict[str, FloatArray]:
    return {
        "distance": np.minimum(reserve_mm / FREE_MM, 1.0),
        "angle": 1.0 - angle_rad / MAX_ANGLE_RAD,
        "depth": 1.0 - depth_mm / length_mm,
        "centrality": np.full(len(reserve_mm), centrality),
    }


def _score(ratings: Mapping[str, FloatArray]) -> FloatArray:
    return np.asarray(sum(WEIGHTS[name] * value for name, value in ratings.items()))


def _corridor(
    entry_mm: FloatArray,
    normal: FloatArray,
    target_mm: FloatArray,
    centrality: float,
    needle: Needle,
    guarded: Sequence[_Guarded],
    covariance_mm2: FloatArray,
    joints: tuple[Mapping[str, float], ...],
) -> Corridor:
    depth, angle = _depth_and_angle(entry_mm[None], normal[None], target_mm)
    radius_mm = float(needle.radius_at(depth)[0])
    structures = tuple(
        StructureDistance(
            structure.name,
            float(needle_distances(surface, entry_mm[None], target_mm)[0]) - radius_mm,
            required_mm,
            hit_probability(
                surface,
                entry_mm,
                target_mm,
                radius_mm=radius_mm,
                covariance_mm2=covariance_mm2,
                sigma_mm=structure.sigma_mm,
            ),
        )
        for structure, surface, required_mm in guarded
    )
    reserve = min((each.clearance_mm - each.required_mm for each in structures), default=FREE_MM)
    ratings = _ratings(np.array([reserve]), angle, depth, centrality, needle.length_mm)
    return Corridor(
        entry_mm,
        target_mm,
        float(depth[0]),
        float(angle[0]),
        float(_score(ratings)[0]),
        {name: float(value[0]) for name, value in ratings.items()},
        structures,
        joints,
    )


def _no_corridor(plan: NeedlePlan, target: NeedleTarget, needle: Needle) -> MarginGuardError:
    entries = plan.region.points_mm
    nearest_mm = min(float(np.linalg.norm(entries - p, axis=1).min()) for p in target.points_mm)
    if nearest_mm > needle.length_mm:
        return InputError(
            f"target: is {nearest_mm:.1f} mm from the nearest entry; expected at most the length "
            f"of the needle, {needle.length_mm:g} mm"
        )
    counts = ", ".join(f"{name} blocks {count}" for name, count in plan.blocked_by().items())
    return NoCorridorError(
        f"corridor: none of {len(entries)} entries is allowed, {counts}; expected at least one"
    )
