"""The small case with phantom images: the probe sweeps over the tumour."""

from pathlib import Path

import numpy as np

from app.files.meshes import write_mesh
from tests.case.images.sequences import with_probe, write_metafile
from tests.cli.small_case import FRAMES, recording, write_small_case
from tests.contour.phantom import slice_of, tumor_from_image, tumour

CLICKED = range(5, 36, 5)
"""Frames whose images are contoured."""


def offset_mm(frame: int) -> float:
    """Where the image of ``frame`` cuts the tumour: from -8 to 8 mm."""
    return 16.0 * frame / (FRAMES - 1) - 8.0


def write_phantom_case(folder: Path) -> Path:
    """Write the case; the frames of probe, needle and tumour are at rest but for the sweep."""
    images = {"probe": "probe", "calibration": "image_to_probe.txt"}
    write_small_case(folder, lambda manifest: manifest.update(images=images))
    solid = tumour()
    write_mesh(folder / "tumor.stl", solid.mesh(4))
    first = tumor_from_image(0.0)
    lines = (" ".join(f"{value!r}" for value in row) for row in first.tolist())
    (folder / "image_to_probe.txt").write_text("\n".join(lines))
    random = np.random.default_rng(3)
    cuts = [tumor_from_image(offset_mm(index)) for index in range(FRAMES)]
    fields = with_probe(recording(), [cut @ np.linalg.inv(first) for cut in cuts])
    pixels = np.array([slice_of(solid, cut, random) for cut in cuts])
    write_metafile(folder / "tracking.igs.mha", pixels, compressed=True, fields=fields)
    return folder
