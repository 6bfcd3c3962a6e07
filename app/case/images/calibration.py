"""Reads the calibration of a probe from a PLUS configuration or a transform file."""

from pathlib import Path

from app.files.plus_config import read_plus_config
from app.files.transforms import read_affine
from app.geometry import ImageCalibration, InputError

IMAGE_FRAME = "image"


def read_image_calibration(path: Path, probe: str) -> ImageCalibration:
    """Read ``ImageToProbe`` for the tracked frame ``probe`` from the file at ``path``.

    A ``.xml`` is a PLUS configuration; others are files as for a rigid transform (ITK, 16 numbers,
    YAML), whose matrix may be scaled here. Raises `InputError` for a file without it, and for a
    matrix that is no calibration.
    """
    if path.suffix.lower() == ".xml":
        matrix = read_plus_config(path).affine(probe, IMAGE_FRAME)
    else:
        matrix = read_affine(path, target=probe, source=IMAGE_FRAME)
    try:
        return ImageCalibration(probe, matrix, IMAGE_FRAME)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
