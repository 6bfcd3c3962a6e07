"""Needle corridors past the forbidden structures of a session."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from app.geometry import InputError, SurfaceMesh, Transform
from app.planning import (
    EntryRegion,
    ForbiddenStructure,
    Needle,
    NeedlePlan,
    NeedleRobot,
    NeedleTarget,
    plan_needle,
)
from app.runtime import SessionContent
from app.session import Role


class SessionCorridors(NamedTuple):
    """A plan, the surface of its target, the structures it keeps from, and its JSON values."""

    plan: NeedlePlan
    target: SurfaceMesh
    forbidden: list[ForbiddenStructure]
    document: dict[str, Any]


def plan_corridors(
    content: SessionContent,
    poses: Mapping[str, Transform],
    region: EntryRegion,
    needle: Needle,
    *,
    target: str,
    point_mm: Sequence[float] | None = None,
    sigma_mm: float,
    window_mm: float | None = None,
    robot: NeedleRobot | None = None,
    obstacles: Mapping[str, SurfaceMesh] = MappingProxyType({}),
) -> SessionCorridors:
    """Plan from ``region`` to the structure ``target``, the tumour if empty.

    ``poses`` are those of the content's `surfaces` in the region's frame, ``point_mm`` is in the
    frame of the target, ``window_mm`` is for displays, ``obstacles`` are surfaces in the region's
    frame that are forbidden, too, with the error of the needle alone; the others are those of
    `plan_needle`. Raises its errors, and `InputError` for a target that is not of the session.
    """
    others = [each for each in content.structures if each.role is Role.FORBIDDEN]
    placed = {name: mesh.transformed(poses[name]) for name, mesh in content.surfaces.items()}
    name = target or content.tumor.frame
    targets = placed.keys() - {each.name for each in others}
    if name not in targets:
        raise InputError(f"target: is {name!r}; expected {' or '.join(sorted(targets))}")
    forbidden = [
        ForbiddenStructure(each.name, placed[each.name], each.stop_mm, each.sigma_mm)
        for each in others
    ] + [ForbiddenStructure(name, mesh, 0.0, 0.0) for name, mesh in obstacles.items()]
    points = (
        NeedleTarget.of_structure(placed[name])
        if point_mm is None
        else NeedleTarget.of_points(
            region.frame, poses[name].apply(np.array([point_mm])), within=placed[name]
        )
    )
    k_sigma = content.margins.k_tre
    plan = plan_needle(
        region, points, needle, forbidden, error=sigma_mm, k_sigma=k_sigma, robot=robot
    )
    inputs = {
        "setup_id": content.setup_id,
        "model_id": content.model_id,
        "registration_id": content.registration_id,
        "frame": region.frame,
        "target": name,
        "frame_from_target": poses[name].matrix.tolist(),
        "window_mm": window_mm,
        "needle": {"length_mm": needle.length_mm, "diameter_mm": needle.diameter_mm}
        | {"bend_mm": needle.bend_mm, "sigma_mm": sigma_mm},
        "k_sigma": k_sigma,
    }
    return SessionCorridors(plan, placed[name], forbidden, inputs | plan.as_document())
