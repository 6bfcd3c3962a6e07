"""Surfaces, the signed distance of a tool to a tumour, and registration with its uncertainty."""

import os

from app import files
from app.fixture import Proximity, ProximityEngine
from app.geometry import SurfaceMesh, Transform
from app.registration import (
    PivotResult,
    RegistrationResult,
    calibrate_pivot,
    predict_tre,
    register_points,
)
from marginguard.values import as_path, checked

__all__ = [
    "PivotResult",
    "Proximity",
    "ProximityEngine",
    "RegistrationResult",
    "SurfaceMesh",
    "calibrate_pivot",
    "load_mesh",
    "predict_tre",
    "register_points",
    "signed_distance",
]


def load_mesh(path: str | os.PathLike[str], *, units: str, frame: str) -> SurfaceMesh:
    """Read a surface from an STL, PLY or OBJ file whose unit is ``units`` (``mm``, ``cm``, ``m``).

    The vertices are in mm in ``frame``. A file with ``SPACE=LPS``, as 3D Slicer writes, is
    converted to RAS. Raises `InputError` for another argument, `MeshError` (a `MarginGuardError`)
    for a file that cannot be read.

    >>> import marginguard as mg
    >>> tumor = mg.load_mesh(mg.example_case() / "tumor.stl", units="mm", frame="tumor")
    >>> tumor.vertices_mm.shape, tumor.open_edges()
    ((10242, 3), 0)
    """
    return files.load_mesh(as_path(path, "path"), units=units, frame=frame)


def signed_distance(tool: SurfaceMesh, tumor: SurfaceMesh, tumor_from_tool: Transform) -> Proximity:
    """The minimum signed distance of the whole ``tool`` to ``tumor``, negative inside, in mm.

    ``tumor_from_tool`` is from ``tool.frame`` to ``tumor.frame``. Prepares both meshes, which takes
    seconds: for many poses make one `ProximityEngine` and call its ``evaluate``. Raises `MeshError`
    for a surface that is not closed, `FrameError` for other frames.

    >>> import numpy as np, trimesh
    >>> import marginguard as mg
    >>> ball, box = trimesh.creation.icosphere(4, radius=10.0), trimesh.creation.box([4, 4, 4])
    >>> tumor = mg.SurfaceMesh("tumor", ball.vertices, ball.faces)
    >>> tool = mg.SurfaceMesh("tool", box.vertices, box.faces)
    >>> pose = mg.Transform("tumor", "tool", np.eye(3), [0.0, 0.0, 15.0])
    >>> round(mg.signed_distance(tool, tumor, pose).signed_distance_mm, 1)
    3.0
    """
    checked(tool, SurfaceMesh, "tool")
    checked(tumor, SurfaceMesh, "tumor")
    checked(tumor_from_tool, Transform, "tumor_from_tool")
    return ProximityEngine(tumor, tool).evaluate(tumor_from_tool)
