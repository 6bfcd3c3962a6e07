"""Mass and inertia of bodies, in kg and m."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray
from app.robot import Link
from app.simulation.convex_parts import hull_corners
from app.simulation.errors import WorldError

M_PER_MM = 1e-3
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Inertia:
    """Mass, centre of mass (3,) and inertia (3, 3) about it, in the axes of the body."""

    mass_kg: float
    centre_m: FloatArray
    tensor_kg_m2: FloatArray


def link_inertia(
    link: Link, density_kg_m3: float | None, what: str, *, is_fixed: bool = False
) -> Inertia | None:
    """The inertia of a link; None for a link without mass and shape, such as a frame.

    From the robot's file; where that gives a mass alone, spread evenly in the hulls of the link's
    shapes; without a mass, these filled with the density. The shapes are those for collision, or
    for display where there are none. With ``is_fixed``, the link is part of another one and may
    have a mass of 0. Raises `WorldError`.
    """
    given = link.inertia
    shapes = [shape.mesh.vertices_mm for shape in link.collisions or link.visuals]
    if given is None:
        if not shapes:
            return None
        if density_kg_m3 is None:
            raise WorldError(
                f"{what} has no mass; expected one in the robot's file, or density_kg_m3"
            )
        return of_hulls(shapes, what, density_kg_m3=density_kg_m3)
    if is_fixed and given.mass_kg == 0.0:
        return None
    if not 0.0 < given.mass_kg < np.inf:
        raise WorldError(f"{what} has a mass of {given.mass_kg:g} kg; expected more than 0")
    pose = given.link_from_inertial
    centre = M_PER_MM * pose.translation_mm
    if given.tensor_kg_m2 is not None:
        tensor = pose.rotation @ given.tensor_kg_m2 @ pose.rotation.T
        return Inertia(given.mass_kg, centre, _checked(tensor, what))
    if not shapes:
        raise WorldError(
            f"{what} has a mass but neither an inertia nor a shape; expected one of them"
        )
    return Inertia(
        given.mass_kg, centre, of_hulls(shapes, what, mass_kg=given.mass_kg).tensor_kg_m2
    )


def of_hulls(
    shapes_mm: Sequence[FloatArray],
    what: str,
    *,
    mass_kg: float | None = None,
    density_kg_m3: float = 1.0,
) -> Inertia:
    """Inertia of the convex hulls of points (n, 3), of ``mass_kg`` in all or of a density.

    Where hulls overlap, their common volume counts for each of them.
    """
    import trimesh  # slow to load

    parts = []
    for points in shapes_mm:
        corners = M_PER_MM * hull_corners(points, what)
        found = trimesh.convex.convex_hull(corners).mass_properties
        parts.append((found.volume, np.array(found.center_mass), np.array(found.inertia)))
    volume = sum(part[0] for part in parts)
    density = density_kg_m3 if mass_kg is None else mass_kg / volume
    centre = sum(part[0] * part[1] for part in parts) / volume
    tensor = np.zeros((3, 3))
    for part_volume, part_centre, part_tensor in parts:
        arm = part_centre - centre
        tensor += part_tensor + part_volume * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Inertia(float(density * volume), np.asarray(centre), density * tensor)


def _checked(tensor: FloatArray, what: str) -> FloatArray:
    """``tensor`` if it is the inertia of some body: finite, and no moment above the other two."""
    moments = np.linalg.eigvalsh(tensor) if np.isfinite(tensor).all() else np.array([np.nan] * 3)
    if not (moments[0] > 0.0 and moments[0] + moments[1] >= (1.0 - _ROUNDING) * moments[2]):
        shown = ", ".join(f"{moment:.3g}" for moment in moments)
        raise WorldError(
            f"{what} has the principal moments of inertia {shown} kg m2; "
            "expected moments above 0, none of them above the sum of the other two"
        )
    return tensor
