"""A DICOM study of closed surfaces: reference series, segmentation, structure set."""

import datetime
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.dicom.contours import signed_area_mm2
from app.dicom.grid import VoxelGrid
from app.dicom.identity import Identity
from app.geometry import InputError, SurfaceMesh

MAX_VOLUME_ERROR = 0.01
"""Share by which the volume of voxels and of contours may differ from that of the surface."""

VOXEL_MM_RANGE = (0.05, 5.0)

SEGMENTATION_FILE, STRUCTURE_SET_FILE = "segmentation.dcm", "structure_set.dcm"


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """A named closed surface in RAS, in mm."""

    name: str
    surface: SurfaceMesh


@dataclass(frozen=True, slots=True)
class StructureVolumes:
    """Volumes in mm³ of one structure: of its surface, its voxels, and its contours."""

    name: str
    surface_mm3: float
    segmentation_mm3: float
    contours_mm3: float


@dataclass(frozen=True, slots=True, eq=False)
class DicomStudy:
    """Files by their name, and the volumes of the structures in them."""

    files: dict[str, bytes]
    volumes: tuple[StructureVolumes, ...]


def dicom_study(
    structures: Sequence[Structure],
    *,
    patient: str,
    version: str,
    voxel_mm: float,
    frame_of_reference_uid: str | None = None,
    date: datetime.date | None = None,
) -> DicomStudy:
    """Make the files of ``structures``, of which the first is the tumour.

    ``patient`` is name and ID. ``voxel_mm`` is the edge of a voxel and the distance of the
    contours' planes. ``frame_of_reference_uid`` is that of images in whose coordinates the
    structures are, otherwise one is made from the tumour. ``date`` is that of the study. UIDs
    depend on the arguments alone.

    Raises `InputError` for two structures of one name, too many voxels, and voxels in which a
    volume differs from that of its surface by more than `MAX_VOLUME_ERROR`; `MeshError` for a
    surface that is not closed.
    """
    from app.dicom.common import file_bytes
    from app.dicom.reference_series import reference_series
    from app.dicom.segmentation import segmentation
    from app.dicom.structure_set import structure_set

    _check_voxel(voxel_mm)
    names = [structure.name for structure in structures]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"structure {name!r}: {names.count(name)} of this name; expected 1")
    surfaces = [_in_lps(structure) for structure in structures]
    content = (patient, version, voxel_mm, frame_of_reference_uid, date, names)
    identity = Identity(
        patient,
        _digest(repr(content), surfaces),
        _digest("", surfaces[:1]),
        frame_of_reference_uid,
        date,
    )
    grid = VoxelGrid.around(surfaces, voxel_mm)
    contours = [grid.contours(surface) for surface in surfaces]
    voxels = [grid.voxels(each) for each in contours]
    volumes = tuple(
        StructureVolumes(
            name,
            surface.signed_volume_mm3,
            float(np.count_nonzero(inside)) * voxel_mm**3,
            sum(signed_area_mm2(each) for slices in planes for each in slices) * voxel_mm,
        )
        for name, surface, inside, planes in zip(names, surfaces, voxels, contours, strict=True)
    )
    for found in volumes:
        _check(found, voxel_mm)
    images = reference_series(grid, identity, version)
    made = (grid, images, identity, version)
    return DicomStudy(
        {
            **{f"image_{k:04}.dcm": file_bytes(image) for k, image in enumerate(images, start=1)},
            SEGMENTATION_FILE: segmentation(names, voxels, *made),
            STRUCTURE_SET_FILE: structure_set(names, contours, *made),
        },
        volumes,
    )


def _in_lps(structure: Structure) -> SurfaceMesh:
    """The surface with x to the left and y to posterior; two axes turn, so normals stay outward."""
    surface = structure.surface.require_closed(f"structure {structure.name!r}")
    return SurfaceMesh(surface.frame, surface.vertices_mm * (-1.0, -1.0, 1.0), surface.faces)


def _digest(text: str, surfaces: Sequence[SurfaceMesh]) -> str:
    digest = hashlib.sha256(text.encode())
    for surface in surfaces:
        digest.update(np.ascontiguousarray(surface.vertices_mm).data)
        digest.update(np.ascontiguousarray(surface.faces).data)
    return digest.hexdigest()


def _check_voxel(voxel_mm: float) -> None:
    low, high = VOXEL_MM_RANGE
    if not low <= voxel_mm <= high:
        raise InputError(f"voxels of {voxel_mm:g} mm; expected {low:g} to {high:g} mm")


def _check(found: StructureVolumes, voxel_mm: float) -> None:
    for what, volume in (("voxels", found.segmentation_mm3), ("contours", found.contours_mm3)):
        if abs(volume / found.surface_mm3 - 1.0) > MAX_VOLUME_ERROR:
            raise InputError(
                f"structure {found.name!r}: {what} at {voxel_mm:g} mm enclose {volume:.1f} mm3 of "
                f"{found.surface_mm3:.1f} mm3; expected 1 % at most: smaller voxels"
            )
