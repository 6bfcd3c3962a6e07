"""DICOM segmentation: one binary segment for each structure."""

from collections.abc import Sequence

import highdicom as hd
import numpy as np
from numpy.typing import NDArray
from pydicom.dataset import Dataset
from pydicom.sr.coding import Code

from app.dicom.common import MANUFACTURER, UNKNOWN_DATE, UNKNOWN_TIME, add_common, file_bytes
from app.dicom.grid import VoxelGrid
from app.dicom.identity import Identity

_TUMOUR = (
    Code("49755003", "SCT", "Morphologically Altered Structure"),
    Code("108369006", "SCT", "Neoplasm"),
)
_OTHER = (Code("85756007", "SCT", "Tissue"), Code("85756007", "SCT", "Tissue"))
_FAMILY = Code("123109", "DCM", "Manual Processing")
"""The contour is a person's; the voxels follow from it."""


def segmentation(
    names: Sequence[str],
    voxels: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    images: Sequence[Dataset],
    identity: Identity,
    version: str,
) -> bytes:
    """A DICOM segmentation of ``voxels``, (slices, rows, columns) each, by ``names``.

    The first name is the tumour's. ``images`` is the reference series of the same grid.
    """
    x, y, z = grid.origin_mm
    size = grid.voxel_mm
    # The axes of the array are slices, rows and columns.
    affine = np.array([[0, 0, size, x], [0, size, 0, y], [size, 0, 0, z], [0, 0, 0, 1.0]])
    volume = hd.Volume(
        np.stack(voxels, axis=-1),
        affine,
        coordinate_system="PATIENT",
        frame_of_reference_uid=identity.frame_of_reference,
        channels={"SegmentNumber": list(range(1, len(names) + 1))},
    )
    algorithm = hd.AlgorithmIdentificationSequence(
        name=f"{MANUFACTURER} voxels of a surface", family=_FAMILY, version=version
    )
    described = []
    for number, name in enumerate(names, start=1):
        category, kind = _TUMOUR if number == 1 else _OTHER
        described.append(
            hd.seg.SegmentDescription(
                segment_number=number,
                segment_label=name[:64],
                segmented_property_category=category,
                segmented_property_type=kind,
                algorithm_type=hd.seg.SegmentAlgorithmTypeValues.SEMIAUTOMATIC,
                algorithm_identification=algorithm,
                tracking_uid=identity.uid(f"segment {name}"),
                tracking_id=name[:64],
            )
        )
    made = hd.seg.Segmentation(
        source_images=list(images),
        pixel_array=volume,
        segmentation_type=hd.seg.SegmentationTypeValues.BINARY,
        segment_descriptions=described,
        series_instance_uid=identity.uid("segmentation series"),
        series_number=2,
        sop_instance_uid=identity.uid("segmentation"),
        instance_number=1,
        manufacturer=MANUFACTURER,
        manufacturer_model_name=MANUFACTURER,
        software_versions=version,
        device_serial_number="none",
        content_label="STRUCTURES",
        content_description="Structures of a MarginGuard case",
        series_description="Structures",
    )
    return file_bytes(_without_clock(made, identity, version))


def _without_clock(made: Dataset, identity: Identity, version: str) -> Dataset:
    """``made`` with the dates and identifiers that depend on the input alone."""
    add_common(made, identity, version, sop_class=made.SOPClassUID, what="segmentation")
    for name in ("InstanceCreationDate", "InstanceCreationTime", "SeriesDate", "SeriesTime"):
        if name in made:
            delattr(made, name)
    for equipment in made.get("ContributingEquipmentSequence", ()):
        if "ContributionDateTime" in equipment:
            del equipment.ContributionDateTime
    made.ContentDate, made.ContentTime = identity.date_text or UNKNOWN_DATE, UNKNOWN_TIME
    organisation = identity.uid("dimensions")
    made.DimensionOrganizationSequence[0].DimensionOrganizationUID = organisation
    for index in made.DimensionIndexSequence:
        index.DimensionOrganizationUID = organisation
    return made
