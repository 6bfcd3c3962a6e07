"""A DICOM study of closed surfaces: reference series, segmentation, structure set."""

import datetime
import hashlib
import re
import uuid
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.dicom.contours import VoxelGrid, signed_area_mm2
from app.geometry import InputError, SurfaceMesh

_NAMESPACE = uuid.UUID("6c1e3d0a-2c0f-5d5e-9a56-0f0f7f1c8b52")
_SEPARATORS = re.compile(r"[\\^=\x00-\x1f\x7f]+")
_MAX_CHARS = 64
_UID = re.compile(r"(0|[1-9]\d*)(\.(0|[1-9]\d*))+")
MAX_VOLUME_ERROR = 0.01
"""Share by which the volume of voxels and of contours may differ from that of the surface."""
VOXEL_MM_RANGE = (0.05, 5.0)
SEGMENTATION_FILE, STRUCTURE_SET_FILE = "segmentation.dcm", "structure_set.dcm"


@dataclass(frozen=True, slots=True)
class Identity:
    """Whose structures they are, and of which study.

    ``patient`` is name and ID. ``content`` is a digest of everything that the files contain: it
    makes the UIDs, so that other content has other UIDs. ``space`` is a digest of what the
    coordinates refer to. ``frame_of_reference_uid`` replaces the UID made from it where the
    coordinates are those of images that exist. ``date`` is that of the study, or unknown.
    """

    patient: str
    content: str
    space: str
    frame_of_reference_uid: str | None = None
    date: datetime.date | None = None

    def __post_init__(self) -> None:
        given = self.frame_of_reference_uid
        if given is not None and not (_UID.fullmatch(given) and len(given) <= _MAX_CHARS):
            raise InputError(
                f"frame of reference: {given!r}; expected a DICOM UID of 64 digits and dots at most"
            )

    @property
    def frame_of_reference(self) -> str:
        """UID of the frame of reference of all files."""
        return self.frame_of_reference_uid or make_uid("frame of reference", self.space)

    def uid(self, what: str) -> str:
        """UID of ``what``, a name within this study."""
        return make_uid(what, self.content)

    @property
    def patient_text(self) -> str:
        """``patient`` without the separators of DICOM, 64 characters at most."""
        text = " ".join(_SEPARATORS.sub(" ", self.patient).split())
        return text[:_MAX_CHARS].strip() or "unknown"

    @property
    def person_name(self) -> str:
        """``patient_text`` as a family name without a given name."""
        return f"{self.patient_text[: _MAX_CHARS - 1]}^"

    @property
    def date_text(self) -> str:
        """``YYYYMMDD``, empty if it is not known."""
        return "" if self.date is None else self.date.strftime("%Y%m%d")


def make_uid(*parts: str) -> str:
    """UID that only depends on ``parts``: a name-based UUID below 2.25 (DICOM PS3.5, B.2)."""
    name = "\n".join(parts)
    return f"2.25.{uuid.uuid5(_NAMESPACE, name).int}"


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
    from app.dicom.dicom_files import file_bytes, reference_series, segmentation, structure_set

    low, high = VOXEL_MM_RANGE
    if not low <= voxel_mm <= high:
        raise InputError(f"voxels of {voxel_mm:g} mm; expected {low:g} to {high:g} mm")
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


def _check(found: StructureVolumes, voxel_mm: float) -> None:
    for what, volume in (("voxels", found.segmentation_mm3), ("contours", found.contours_mm3)):
        if abs(volume / found.surface_mm3 - 1.0) > MAX_VOLUME_ERROR:
            raise InputError(
                f"structure {found.name!r}: {what} at {voxel_mm:g} mm enclose {volume:.1f} mm3 of "
                f"{found.surface_mm3:.1f} mm3; expected 1 % at most: smaller voxels"
            )
