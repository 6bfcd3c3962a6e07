"""Files of a DICOM study: the reference series, the segmentation and the RT structure set."""

import io
from collections.abc import Sequence

import highdicom as hd
import numpy as np
from numpy.typing import NDArray
from pydicom.dataelem import DataElement
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.sr.coding import Code
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, RTStructureSetStorage

from app.dicom.contours import VoxelGrid, with_keyholes
from app.dicom.study import Identity
from app.geometry import FloatArray

MANUFACTURER = "MarginGuard"
UNKNOWN_DATE, UNKNOWN_TIME = "19700101", "000000"
"""Where DICOM requires a date and none is known."""
DESCRIPTION = "Reference grid, no image (all pixels equal)"
_AIR_HU = -1024
_TUMOUR = (
    Code("49755003", "SCT", "Morphologically Altered Structure"),
    Code("108369006", "SCT", "Neoplasm"),
)
_OTHER = (Code("85756007", "SCT", "Tissue"), Code("85756007", "SCT", "Tissue"))
_FAMILY = Code("123109", "DCM", "Manual Processing")
"""The contour is a person's; the voxels follow from it."""
_COLOURS = ((200, 60, 60), (60, 120, 200), (230, 160, 0), (90, 170, 90), (150, 90, 180))
_CONTOUR_DATA = 0x30060050
Contours = Sequence[tuple[FloatArray, ...]]
"""Contours (n, 2) in mm of each slice."""


def add_common(
    file: Dataset, identity: Identity, version: str, *, sop_class: str, what: str
) -> None:
    """Set patient, study, equipment and the identity of one instance, ``what``."""
    file.SpecificCharacterSet = "ISO_IR 192"
    file.SOPClassUID = sop_class
    file.SOPInstanceUID = identity.uid(what)
    file.PatientName = identity.person_name
    file.PatientID = identity.patient_text
    file.PatientBirthDate = file.PatientSex = ""
    file.StudyInstanceUID = identity.uid("study")
    file.StudyDate, file.StudyTime = identity.date_text, ""
    file.StudyID = "1"
    file.AccessionNumber = file.ReferringPhysicianName = ""
    file.Manufacturer = file.ManufacturerModelName = MANUFACTURER
    file.DeviceSerialNumber = "none"
    file.SoftwareVersions = version
    file.FrameOfReferenceUID = identity.frame_of_reference
    file.PositionReferenceIndicator = ""


def file_bytes(file: Dataset) -> bytes:
    """``file`` as a DICOM file with explicit lengths, little endian."""
    file.file_meta = FileMetaDataset()
    file.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    file.file_meta.MediaStorageSOPClassUID = file.SOPClassUID
    file.file_meta.MediaStorageSOPInstanceUID = file.SOPInstanceUID
    stream = io.BytesIO()
    file.save_as(stream, enforce_file_format=True)
    return stream.getvalue()


def reference_series(grid: VoxelGrid, identity: Identity, version: str) -> list[Dataset]:
    """One CT image a slice, from inferior to superior; every pixel is air.

    Segmentations and structure sets must refer to images. These give them a geometry where there
    are none; ``SeriesDescription`` and ``ImageComments`` say so.
    """
    columns, rows, slices = grid.shape
    pixels = np.zeros((rows, columns), dtype="<u2").tobytes()
    x, y, _ = grid.origin_mm
    heights = grid.axis_mm(2).tolist()
    images = []
    for number in range(slices):
        image = Dataset()
        add_common(image, identity, version, sop_class=CTImageStorage, what=f"image {number}")
        image.ImageType = ["DERIVED", "SECONDARY", "AXIAL"]
        image.Modality = "CT"
        image.SeriesInstanceUID = identity.uid("reference series")
        image.SeriesNumber, image.InstanceNumber = 1, number + 1
        image.SeriesDescription = DESCRIPTION
        image.ImageComments = DESCRIPTION
        image.AcquisitionNumber = image.KVP = image.PatientPosition = None
        image.Laterality = ""  # required, though empty, where no body part is known
        image.ContentDate = image.ContentTime = ""
        image.ImagePositionPatient = [_decimal(v) for v in (x, y, heights[number])]
        image.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
        image.PixelSpacing = [_decimal(grid.voxel_mm)] * 2
        image.SliceThickness = image.SpacingBetweenSlices = _decimal(grid.voxel_mm)
        image.SliceLocation = _decimal(heights[number])
        image.Rows, image.Columns = rows, columns
        image.SamplesPerPixel = 1
        image.PhotometricInterpretation = "MONOCHROME2"
        image.BitsAllocated, image.BitsStored, image.HighBit = 16, 16, 15
        image.PixelRepresentation = 0
        image.RescaleIntercept, image.RescaleSlope = _AIR_HU, 1
        image.RescaleType = "HU"
        image.PixelData = pixels
        images.append(image)
    return images


def _decimal(value: float) -> str:
    """A decimal string of DICOM, 16 characters at most."""
    return f"{value + 0.0:.6f}".rstrip("0").rstrip(".")


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


def structure_set(
    names: Sequence[str],
    contours: Sequence[Contours],
    grid: VoxelGrid,
    images: Sequence[Dataset],
    identity: Identity,
    version: str,
) -> bytes:
    """An RT structure set of ``contours``, by ``names``; the first one is the tumour's.

    A hole in a contour is joined to it by a channel without width.
    """
    file = Dataset()
    add_common(file, identity, version, sop_class=RTStructureSetStorage, what="structure set")
    file.Modality = "RTSTRUCT"
    file.SeriesInstanceUID = identity.uid("structure set series")
    file.SeriesNumber, file.InstanceNumber = 3, 1
    file.SeriesDescription = "Structures"
    file.OperatorsName = ""
    file.StructureSetLabel = "STRUCTURES"
    file.StructureSetDate, file.StructureSetTime = identity.date_text, ""
    file.ApprovalStatus = "UNAPPROVED"
    file.ReferencedFrameOfReferenceSequence = [_referenced(images, identity)]
    file.StructureSetROISequence = []
    file.ROIContourSequence = []
    file.RTROIObservationsSequence = []
    heights = grid.axis_mm(2).tolist()
    for number, (name, slices) in enumerate(zip(names, contours, strict=True), start=1):
        roi = Dataset()
        roi.ROINumber, roi.ROIName = number, name[:64]
        roi.ReferencedFrameOfReferenceUID = identity.frame_of_reference
        roi.ROIGenerationAlgorithm = "SEMIAUTOMATIC"
        file.StructureSetROISequence.append(roi)
        observation = Dataset()
        observation.ObservationNumber = observation.ReferencedROINumber = number
        observation.RTROIInterpretedType = "GTV" if number == 1 else "CONTROL"
        observation.ROIInterpreter = ""
        file.RTROIObservationsSequence.append(observation)
        shape = Dataset()
        shape.ROIDisplayColor = list(_COLOURS[(number - 1) % len(_COLOURS)])
        shape.ReferencedROINumber = number
        shape.ContourSequence = [
            _contour(contour, height, image)
            for height, image, plane in zip(heights, images, slices, strict=True)
            for contour in with_keyholes(plane)
        ]
        file.ROIContourSequence.append(shape)
    return file_bytes(file)


def _contour(points: FloatArray, height_mm: float, image: Dataset) -> Dataset:
    contour = Dataset()
    contour.ContourImageSequence = [_reference(image)]
    contour.ContourGeometricType = "CLOSED_PLANAR"
    contour.NumberOfContourPoints = len(points)
    numbers = [f"{value:.4f}" for x, y in points.tolist() for value in (x, y, height_mm)]
    # Converted already: pydicom would parse each number and check its length, which these meet.
    contour[_CONTOUR_DATA] = DataElement(_CONTOUR_DATA, "DS", numbers, already_converted=True)
    return contour


def _referenced(images: Sequence[Dataset], identity: Identity) -> Dataset:
    """The frame of reference with study, series and images."""
    series = Dataset()
    series.SeriesInstanceUID = images[0].SeriesInstanceUID
    series.ContourImageSequence = [_reference(image) for image in images]
    study = Dataset()
    study.ReferencedSOPClassUID = "1.2.840.10008.3.1.2.3.1"  # detached study management, retired
    study.ReferencedSOPInstanceUID = images[0].StudyInstanceUID
    study.RTReferencedSeriesSequence = [series]
    frame = Dataset()
    frame.FrameOfReferenceUID = identity.frame_of_reference
    frame.RTReferencedStudySequence = [study]
    return frame


def _reference(image: Dataset) -> Dataset:
    reference = Dataset()
    reference.ReferencedSOPClassUID = image.SOPClassUID
    reference.ReferencedSOPInstanceUID = image.SOPInstanceUID
    return reference
