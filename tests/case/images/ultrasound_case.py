"""The small case with ultrasound: an image with each frame, in the needle's plane z = 0."""

from pathlib import Path
from typing import Any

import numpy as np

from tests.case.images.sequences import some_pixels, write_metafile
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
    fields = {}
    for line in recording().splitlines():
        key, _, value = line.partition(" = ")
        if key.startswith("Seq_"):
            fields[key] = value
    identity = " ".join(f"{value:g}" for value in np.eye(4).ravel())
    for index in range(FRAMES):
        frame = f"Seq_Frame{index:04}_"
        fields[f"{frame}ProbeToTrackerTransform"] = identity
        status = "OUT_OF_VIEW" if index == LOST else "OK"
        fields[f"{frame}ProbeToTrackerTransformStatus"] = status
        fields[f"{frame}ImageStatus"] = "INVALID" if index == INVALID else "OK"
    ordered = dict(sorted(fields.items(), key=lambda item: item[0][:13]))
    pixels = some_pixels(FRAMES, ROWS, COLUMNS)
    write_metafile(folder / "tracking.igs.mha", pixels, compressed=True, fields=ordered)
    return folder
