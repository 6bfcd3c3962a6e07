"""Images without a picture: the grid that segmentation and structure set refer to."""

import numpy as np
from pydicom.dataset import Dataset
from pydicom.uid import CTImageStorage

from app.dicom.common import add_common
from app.dicom.grid import VoxelGrid
from app.dicom.identity import Identity

DESCRIPTION = "Reference grid, no image (all pixels equal)"
_AIR_HU = -1024


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
