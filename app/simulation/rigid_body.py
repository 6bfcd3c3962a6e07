"""Convex parts of surfaces, because MuJoCo's contacts are between convex bodies; mass and inertia.

CoACD (Wei et al., Approximate Convex Decomposition for 3D Meshes with Collision-Aware Concavity and
Tree Search, SIGGRAPH 2022) takes seconds to minutes, so its results are cached on disk by content.
A cached file holds a checksum; a damaged one is computed again.
"""

import hashlib
import io
import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from app.files.atomic_io import write_file
from app.files.extras import check_installed
from app.fixture.proximity.field_cache import cache_folder
from app.geometry import FloatArray, MarginGuardError, SurfaceMesh
from app.robot import Link
from app.simulation.errors import WorldError
from app.simulation.world_entries import Collision

_LOG = logging.getLogger(__name__)

FORMAT = b"marginguard parts 1\n"
"""First bytes of a file; increment the number when the computation changes."""

PARTS_FOLDER, ENDING = "parts", ".parts"
CONCAVITY = 0.05
"""CoACD's threshold: parts differ from the surface by at most about this share of its size."""

_DIGEST = 32
M_PER_MM = 1e-3
_ROUNDING = 1e-9


def convex_parts(mesh: SurfaceMesh, collision: Collision, what: str) -> list[FloatArray]:
    """Corners (n, 3) in mm of each convex part of ``mesh``, none where it touches nothing.

    ``what`` names the body in messages. Raises `WorldError` for a surface without volume.
    """
    if collision == "none":
        return []
    if collision == "hull":
        return [hull_corners(mesh.vertices_mm, what)]
    return [hull_corners(part, what) for part in _decomposition(mesh, what)]


def hull_corners(points_mm: FloatArray, what: str) -> FloatArray:
    """Corners (n, 3) of the convex hull of points (m, 3); `WorldError` where it is flat."""
    try:
        return points_mm[np.sort(ConvexHull(points_mm).vertices)]
    except (QhullError, ValueError) as error:
        raise WorldError(
            f"{what}: its surface encloses no volume; expected a body of three dimensions"
        ) from error


def _decomposition(mesh: SurfaceMesh, what: str) -> list[FloatArray]:
    path = cache_folder() / PARTS_FOLDER / f"{_key(mesh)}{ENDING}"
    parts = _read(path)
    if parts is None:
        parts = _decompose(mesh, what)
        _write(path, parts)
    return parts


def _decompose(mesh: SurfaceMesh, what: str) -> list[FloatArray]:
    try:
        import coacd
    except ModuleNotFoundError:
        check_installed("coacd", otherwise="give 'collision: hull'")
        raise
    mesh.require_closed(what)
    coacd.set_log_level("error")
    surface = coacd.Mesh(mesh.vertices_mm, mesh.faces)
    parts = coacd.run_coacd(surface, threshold=CONCAVITY, seed=0)
    return [np.asarray(vertices, dtype=np.float64) for vertices, _ in parts]


def _key(mesh: SurfaceMesh) -> str:
    digest = hashlib.sha256(FORMAT)
    digest.update(f"{CONCAVITY!r} {mesh.vertices_mm.shape} {mesh.faces.shape} ".encode())
    digest.update(np.ascontiguousarray(mesh.vertices_mm).data)
    digest.update(np.ascontiguousarray(mesh.faces).data)
    return digest.hexdigest()


def _read(path: Path) -> list[FloatArray] | None:
    """The parts in a file; None where it does not exist or is damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    head = len(FORMAT) + _DIGEST
    body = content[head:]
    if content[:head] != FORMAT + hashlib.sha256(body).digest():
        _LOG.warning("%s is damaged or of another version: computing it again", path)
        return None
    with np.load(io.BytesIO(body), allow_pickle=False) as arrays:
        return [arrays[name] for name in arrays.files]


def _write(path: Path, parts: list[FloatArray]) -> None:
    """Store the parts; a folder that cannot be used costs time in the next run and no more."""
    buffer = io.BytesIO()
    np.savez(buffer, *parts)
    body = buffer.getvalue()
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if path.parent.stat().st_uid != os.geteuid():
            raise PermissionError(f"{path.parent} belongs to another user")
        write_file(path, FORMAT + hashlib.sha256(body).digest() + body)
    except (OSError, MarginGuardError) as error:
        _LOG.info("cannot store convex parts: %s", error)


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
