"""The small case with phantom images: the probe sweeps over the tumour."""

from pathlib import Path

import numpy as np

from app.files.meshes import write_mesh
from tests.case.images.sequences import write_metafile
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
    fields = {}
    for line in recording().splitlines():
        key, _, value = line.partition(" = ")
        if key.startswith("Seq_"):
            fields[key] = value
    random, pixels = np.random.default_rng(3), []
    for index in range(FRAMES):
        frame, pose = f"Seq_Frame{index:04}_", tumor_from_image(offset_mm(index))
        probe = pose @ np.linalg.inv(first)
        numbers = " ".join(f"{value:.9g}" for value in probe.ravel())
        fields[f"{frame}ProbeToTrackerTransform"] = numbers
        fields[f"{frame}ProbeToTrackerTransformStatus"] = "OK"
        fields[f"{frame}ImageStatus"] = "OK"
        pixels.append(slice_of(solid, pose, random))
    ordered = dict(sorted(fields.items(), key=lambda item: item[0][:13]))
    write_metafile(folder / "tracking.igs.mha", np.array(pixels), compressed=True, fields=ordered)
    return folder
