"""Reads a volume of values, such as a CT or MR scan: NRRD, NIfTI, MetaImage, or a DICOM series.

SimpleITK parses the files. Sizes are checked by the header before the values are read. Positions
are LPS in ITK; here they are RAS, as in 3D Slicer.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.files.bounded_io import is_file, is_folder
from app.files.extras import check_installed
from app.geometry import FloatArray, InputError

ENDINGS = (".nrrd", ".nhdr", ".nii", ".nii.gz", ".mha", ".mhd")
MAX_VOXELS = 512**3
_RAS_FROM_LPS = np.diag([-1.0, -1.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Volume:
    """Values (i, j, k), float32 and read-only, and where they are.

    ``ras_from_index`` (4, 4) maps an index (i, j, k, 1) to the centre of its voxel, mm RAS.
    """

    values: NDArray[Any]
    ras_from_index: FloatArray


def read_volume(path: Path) -> Volume:
    """Read the file at ``path``, or the one DICOM series in the folder ``path``.

    Raises `InputError` for other endings, a folder without a series or with several, more than
    `MAX_VOXELS`, values that are not one number per voxel or not finite, and unreadable content.
    """
    check_installed("SimpleITK")
    import SimpleITK

    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    try:
        image = SimpleITK.Cast(
            _series(path) if is_folder(path) else _file(path), SimpleITK.sitkFloat32
        )
    except RuntimeError as error:  # what SimpleITK raises for everything
        raise InputError(f"{path}: {_reason(error)}; expected a volume") from error
    values = SimpleITK.GetArrayFromImage(image).transpose(2, 1, 0)
    if not np.isfinite(values).all():
        raise InputError(f"{path}: some of its values are not finite; expected numbers")
    values.flags.writeable = False
    matrix = np.eye(4)
    directions = np.reshape(image.GetDirection(), (3, 3))
    matrix[:3, :3] = _RAS_FROM_LPS @ directions @ np.diag(image.GetSpacing())
    matrix[:3, 3] = _RAS_FROM_LPS @ image.GetOrigin()
    return Volume(values, matrix)


def _file(path: Path) -> Any:
    import SimpleITK

    if not is_file(path):
        raise InputError(f"{path}: no such file; expected a volume")
    if not path.name.lower().endswith(ENDINGS):
        raise InputError(
            f"{path}: not the name of a volume; expected {', '.join(ENDINGS)} or the folder of a "
            "DICOM series"
        )
    reader = SimpleITK.ImageFileReader()
    reader.SetFileName(str(path))
    reader.ReadImageInformation()
    _check(path, reader, reader.GetSize())
    return reader.Execute()


def _series(path: Path) -> Any:
    import SimpleITK

    reader = SimpleITK.ImageSeriesReader()
    found = reader.GetGDCMSeriesIDs(str(path))
    if len(found) != 1:
        raise InputError(f"{path}: {len(found)} DICOM series; expected a folder with one")
    names = reader.GetGDCMSeriesFileNames(str(path), found[0])
    first = SimpleITK.ImageFileReader()
    first.SetFileName(names[0])
    first.ReadImageInformation()
    _check(path, first, (*first.GetSize()[:2], len(names)))
    reader.SetFileNames(names)
    return reader.Execute()


def _check(path: Path, reader: Any, size: tuple[int, ...]) -> None:
    if len(size) != 3 or reader.GetNumberOfComponents() != 1:
        raise InputError(
            f"{path}: {len(size)} dimensions with {reader.GetNumberOfComponents()} values each; "
            "expected 3 with one"
        )
    if not min(size) >= 2 or math.prod(size) > MAX_VOXELS:
        raise InputError(
            f"{path}: {' x '.join(map(str, size))} voxels; expected at least 2 on each axis and "
            f"{MAX_VOXELS} in all"
        )


def _reason(error: RuntimeError) -> str:
    """The last line of ITK's description, without the place in its sources."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return ascii(lines[-1].removeprefix("ITK ERROR: "))[1:160] if lines else "not readable"
