"""The small case with ultrasound: an image with each frame, in the needle's plane z = 0."""

from pathlib import Path
from typing import Any

import numpy as np

from tests.case.images.sequences import some_pixels, with_probe, write_metafile
from tests.cli.small_case import FRAMES, recording, write_small_case

COLUMNS, ROWS = 40, 30
PIXEL_MM = 0.5
INVALID = 7
LOST = 9

PROBE_FROM_IMAGE = np.array([[PIXEL_MM, 0, 0, -10], [0, PIXEL_MM, 0, -8], [0, 0, PIXEL_MM, 0]])
"""Column and row along x and y; the centre of the ball is at column 20, row 16."""


def write_ultrasound_case(folder: Path, **changes: Any) -> Path:
    """Write the case; ``changes`` are those of ``images``.

    The probe stays at the tracker's origin. Image `INVALID` is marked invalid, and in frame `LOST`
    the probe is out of view.
    """
    images = {"probe": "probe", "calibration": "image_to_probe.txt", **changes}
    write_small_case(folder, lambda manifest: manifest.update(images=images))
    numbers = np.vstack([PROBE_FROM_IMAGE, (0, 0, 0, 1)]).ravel()
    (folder / "image_to_probe.txt").write_text(" ".join(f"{value:g}" for value in numbers))
    fields = with_probe(recording(), [np.eye(4)] * FRAMES, lost=LOST, invalid=INVALID)
    pixels = some_pixels(FRAMES, ROWS, COLUMNS)
    write_metafile(folder / "tracking.igs.mha", pixels, compressed=True, fields=fields)
    return folder
