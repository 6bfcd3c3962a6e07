"""Builds the tumour's surface from a file, with notes for the surgeon."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from app.case.tumor.segmentation import read_segment
from app.files.landmarks import read_points
from app.geometry import MeshError, SurfaceMesh

SEGMENTATION_ENDING = ".nrrd"


@dataclass(frozen=True, slots=True, eq=False)
class BuiltTumor:
    """A closed surface, and notes on what it was built from."""

    mesh: SurfaceMesh
    notes: tuple[str, ...]


def tumor_from_contour(path: Path, *, frame: str) -> BuiltTumor:
    """Build the surface around the points of ``path``, a file for `read_points`.

    The file's coordinates, in RAS axes, are those of ``frame``. Raises `InputError` for a file
    that cannot be read, `MeshError` for points that do not span a solid.
    """
    from app.case.tumor.contour_surface import surface_around  # slow to load

    points = np.array([position for _, position in read_points(path)])
    try:
        mesh = surface_around(points, frame)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error
    return BuiltTumor(mesh, (f"the tumour is the rounded convex hull of {len(points)} points",))


def tumor_from_segmentation(path: Path, *, frame: str, segment: str | None) -> BuiltTumor:
    """Build the surface of one segment of the ``.nrrd`` file ``path``, its hollows filled.

    ``segment``: name, identifier or value; None where the file holds only one. The file's
    coordinates, in RAS axes, are those of ``frame``. Raises `InputError` for a file that cannot be
    read and a missing segment, `MeshError` for a segment that is too large.
    """
    from app.case.tumor.label_surface import surface_of_labels  # slow to load

    labels = read_segment(path, segment)
    filled = scipy.ndimage.binary_fill_holes(labels.marked)
    try:
        mesh = surface_of_labels(filled, labels.ras_from_index, frame)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error
    voxels = int(np.count_nonzero(labels.marked))
    notes = [f"the tumour is segment {labels.name!r} of {path.name}, {voxels} voxels"]
    hollow = int(np.count_nonzero(filled)) - voxels
    if hollow:
        notes.append(f"{hollow} voxels that the segment encloses count as tumour")
    parts = scipy.ndimage.label(filled, scipy.ndimage.generate_binary_structure(3, 3))[1]
    if parts > 1:
        notes.append(f"the segment has {parts} parts that do not touch")
    if labels.at_border:
        notes.append("the segment reaches the border of its volume: it may go on beyond")
    return BuiltTumor(mesh, tuple(notes))
