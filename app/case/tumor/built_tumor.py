"""Builds the tumour's surface from a file, with notes for the surgeon.

A label map is 3D Slicer's ``.seg.nrrd``, or a plain ``.nrrd``. The first lists its segments in
header fields ``Segment0_Name``, ``Segment0_ID``, ``Segment0_LabelValue`` and ``Segment0_Layer``.
Segments that do not overlap share a layer, each with its own value; others have layers of their
own. In a plain label map each value is a segment.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from app.case.tumor.nrrd_file import NrrdVolume, read_nrrd
from app.files.landmarks import read_points
from app.geometry import FloatArray, InputError, MeshError, SurfaceMesh

MAX_LABELS = 256
"""Distinct values of a plain label map; a file with more is refused as an image."""

_BLOCK_VOXELS = 1 << 20

_FIELD = re.compile(r"Segment(\d{1,9})_(ID|Name|LabelValue|Layer)")
_REPRESENTATIONS = ("Segmentation_SourceRepresentation", "Segmentation_MasterRepresentation")
_BINARY = "Binary labelmap"

_CUT_OUT = "Segmentation_ReferenceImageExtentOffset"
"""Slicer saves the box around the segments; this field holds its position in the image."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelMap:
    """The voxels of one segment, cropped to their bounding box.

    ``marked`` (i, j, k) is true inside the segment; ``ras_from_index`` (3, 4) maps an index to the
    centre of its voxel in mm. ``at_border``: whether the segment reaches the border of a volume
    that was not cropped to it.
    """

    name: str
    marked: NDArray[np.bool_]
    ras_from_index: FloatArray
    at_border: bool


@dataclass(frozen=True, slots=True)
class _Segment:
    identifier: str
    name: str
    layer: int
    label: int

    def __str__(self) -> str:
        if self.name == self.identifier:
            return self.name
        return f"{self.name} ({self.identifier})"


def read_segment(path: Path, name: str | None) -> LabelMap:
    """Read the segment of the file at ``path`` with the name or identifier ``name``.

    In a plain label map ``name`` is a value. None selects the only segment of a file. Raises
    `InputError` as `read_nrrd` does, for a missing segment, listing those of the file, and for a
    segment without a voxel.
    """
    volume = read_nrrd(path)
    segments = _named_segments(volume, path) or _plain_labels(volume, path)
    segment = _select(segments, name, path)
    marked = volume.layers[segment.layer] == segment.label
    if not marked.any():
        raise InputError(f"{path}: segment {segment} has no voxel; expected one or more")
    box, at_border = _box(marked)
    ras_from_index = np.array(volume.ras_from_index)
    ras_from_index[:, 3] += ras_from_index[:, :3] @ [side.start for side in box]
    at_border &= _CUT_OUT not in volume.fields
    return LabelMap(segment.name, marked[box], ras_from_index, at_border)


def _named_segments(volume: NrrdVolume, path: Path) -> list[_Segment]:
    for key in _REPRESENTATIONS:
        representation = volume.fields.get(key, _BINARY)
        if representation != _BINARY:
            raise InputError(f"{path}: {key} is {representation!r}; expected {_BINARY!r}")
    found: dict[int, dict[str, str]] = {}
    for field, value in volume.fields.items():
        match = _FIELD.fullmatch(field)
        if match:
            found.setdefault(int(match[1]), {})[match[2]] = value
    return [_segment(found[number], number, volume, path) for number in sorted(found)]


def _segment(entry: Mapping[str, str], number: int, volume: NrrdVolume, path: Path) -> _Segment:
    missing = [key for key in ("ID", "Name", "LabelValue", "Layer") if key not in entry]
    if missing:
        raise InputError(
            f"{path}: Segment{number}_{missing[0]} is missing: Slicer writes it since 4.11; save "
            "the segmentation with a newer Slicer"
        )
    try:
        layer, label = int(entry["Layer"]), int(entry["LabelValue"])
    except ValueError as error:
        raise InputError(f"{path}: Segment{number} is {dict(entry)}: {error}") from error
    if not 0 <= layer < len(volume.layers) or label == 0:
        raise InputError(
            f"{path}: Segment{number} is value {label} of layer {layer}; expected a value "
            f"other than 0 and a layer from 0 to {len(volume.layers) - 1}"
        )
    return _Segment(entry["ID"], entry["Name"], layer, label)


def _plain_labels(volume: NrrdVolume, path: Path) -> list[_Segment]:
    if len(volume.layers) != 1:
        raise InputError(
            f"{path} has {len(volume.layers)} layers and no segment names; expected 1 layer"
        )
    voxels = volume.layers[0].ravel(order="K")
    labels: set[int] = set()
    for start in range(0, voxels.size, _BLOCK_VOXELS):  # an image is refused at its first block
        labels.update(np.unique(voxels[start : start + _BLOCK_VOXELS]).tolist())
        labels.discard(0)
        if len(labels) > MAX_LABELS:
            raise InputError(
                f"{path} holds {len(labels)} different values or more; expected a label map "
                f"of up to {MAX_LABELS}, not an image"
            )
    return [_Segment(str(label), str(label), 0, label) for label in sorted(labels)]


def _select(segments: list[_Segment], name: str | None, path: Path) -> _Segment:
    found = ", ".join(map(str, segments)) or "none"
    if name is None:
        if len(segments) != 1:
            raise InputError(
                f"{path} holds {len(segments)} segments: {found}; expected the name of one"
            )
        return segments[0]
    matching = [segment for segment in segments if name in (segment.identifier, segment.name)]
    if len(matching) != 1:
        raise InputError(
            f"{path} has {len(matching)} segments with the name {name!r}; expected one of: {found}"
        )
    return matching[0]


def _box(marked: NDArray[np.bool_]) -> tuple[tuple[slice, ...], bool]:
    """The slices of the bounding box of the marked voxels, and whether it reaches the border."""
    box, at_border = [], False
    for axis in range(3):
        others = tuple(other for other in range(3) if other != axis)
        used = np.flatnonzero(marked.any(axis=others))
        box.append(slice(int(used[0]), int(used[-1]) + 1))
        at_border |= bool(used[0] == 0 or used[-1] == marked.shape[axis] - 1)
    return tuple(box), at_border


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
    from app.case.tumor.surfaces import surface_around  # slow to load

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
    from app.case.tumor.surfaces import surface_of_labels  # slow to load

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
