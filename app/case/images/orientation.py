"""Orientation of ultrasound images, normalised to MF.

IGSIO names the directions of columns and rows by letters: the first is where the column number
rises to, the second where the row number rises to. M: marked side of the probe, U: unmarked side,
F: far from the probe, N: near to it. A third letter, A or D, is the direction of the slices of a
volume; for a single slice it has no meaning. PLUS converts every image to MF when it reads a file,
and ``ImageToProbe`` is for that orientation.
"""

from dataclasses import replace

import numpy as np

from app.geometry import ImageSample, InputError, Pixels

STANDARD = "MF"
_SIDES = ("MF", "MN", "UF", "UN")
ORIENTATIONS = (*_SIDES, *(name[::-1] for name in _SIDES))
"""The eight orientations of one slice."""


def checked_orientation(text: str, where: str) -> str:
    """Return the two letters of ``text`` in capitals; `InputError`, with ``where``, for others."""
    name = text.strip().upper()
    if len(name) == 3 and name[2] in "AD":
        name = name[:2]
    if name not in ORIENTATIONS:
        raise InputError(
            f"{where} is {text[:60]!r}; expected {', '.join(ORIENTATIONS)}, also with A or D after "
            "it"
        )
    return name


def to_standard(pixels: Pixels, orientation: str) -> Pixels:
    """Return ``pixels`` (rows, columns, ...) of a checked ``orientation`` in MF.

    A copy only where something changes. RF lines (``FM``) become columns.
    """
    if orientation[0] in "FN":
        pixels = np.swapaxes(pixels, 0, 1)
        orientation = orientation[::-1]
    if orientation[0] == "U":
        pixels = pixels[:, ::-1]
    if orientation[1] == "N":
        pixels = pixels[::-1]
    return np.ascontiguousarray(pixels)


def standard_image(image: ImageSample, orientation: str) -> ImageSample:
    """Return ``image`` of a checked ``orientation`` in MF; one without pixels as it is."""
    if image.pixels is None:
        return image
    pixel_mm = image.pixel_mm
    if pixel_mm is not None and orientation[0] in "FN":
        pixel_mm = pixel_mm[::-1]
    return replace(image, pixels=to_standard(image.pixels, orientation), pixel_mm=pixel_mm)
