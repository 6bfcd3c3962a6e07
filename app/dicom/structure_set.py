"""DICOM RT structure set: closed planar contours of each structure."""

from collections.abc import Sequence

from pydicom.dataelem import DataElement
from pydicom.dataset import Dataset
from pydicom.uid import RTStructureSetStorage

from app.dicom.common import add_common, file_bytes
from app.dicom.contours import with_keyholes
from app.dicom.grid import VoxelGrid
from app.dicom.identity import Identity
from app.geometry import FloatArray

_COLOURS = ((200, 60, 60), (60, 120, 200), (230, 160, 0), (90, 170, 90), (150, 90, 180))

_CONTOUR_DATA = 0x30060050

Contours = Sequence[tuple[FloatArray, ...]]
"""Contours (n, 2) in mm of each slice."""


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
