"""Convex parts of surfaces, because MuJoCo's contacts are between convex bodies.

CoACD (Wei et al., Approximate Convex Decomposition for 3D Meshes with Collision-Aware Concavity and
Tree Search, SIGGRAPH 2022) takes seconds to minutes, so its results are cached on disk by content.
A cached file holds a checksum; a damaged one is computed again.
"""

import hashlib
import io
import logging
import os
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from app.files.atomic_io import write_file
from app.fixture.proximity.field_cache import cache_folder
from app.geometry import FloatArray, MarginGuardError, SurfaceMesh
from app.simulation.errors import WorldError
from app.simulation.world_entries import Collision

_LOG = logging.getLogger(__name__)

FORMAT = b"marginguard parts 1\n"
"""First bytes of a file; increment the number when the computation changes."""

PARTS_FOLDER, ENDING = "parts", ".parts"
CONCAVITY = 0.05
"""CoACD's threshold: parts differ from the surface by at most about this share of its size."""

_DIGEST = 32


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
        from app.files.extras import check_installed

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
