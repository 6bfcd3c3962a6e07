"""Images of ultrasound sequences: raw, deflated, in a second file, as NRRD."""

import gzip
import zlib
from pathlib import Path

from app.case import ImageSequence
from app.geometry import ImageCalibration, image_corners
from benchmarks.fuzz.mutators.containers import NRRD
from benchmarks.fuzz.mutators.raw import RAW
from benchmarks.fuzz.mutators.text import TEXT
from benchmarks.fuzz.parser import FuzzedParser

_MATRIX = "1 0 0 10 0 0 -1 20 0 1 0 30 0 0 0 1"
_SCALED = (0.1, 0, 0, 1, 0, 0.1, 0, 2, 0, 0, 0.1, 3, 0, 0, 0, 1)
_PIXELS = bytes(range(3 * 4 * 3))


def _read_images(path: Path) -> None:
    """Read every image and its place, then the first one again."""
    calibration = ImageCalibration("probe", _SCALED)
    with ImageSequence(path) as sequence:
        for image in sequence:
            pose = sequence.pose(image.number, calibration, "reference")
            if pose.matrix is not None:
                image_corners(pose.matrix, *sequence.size)
        sequence.image(0)


def _frames(mark: str) -> str:
    return "".join(
        f"Seq_Frame{index:04}_{name}{mark}{value}\n"
        for index in range(3)
        for name, value in (
            ("ProbeToTrackerTransform", _MATRIX),
            ("ProbeToTrackerTransformStatus", "OK"),
            ("ReferenceToTrackerTransform", _MATRIX),
            ("Timestamp", f"{index}.25"),
            ("ImageStatus", "INVALID" if index == 1 else "OK"),
        )
    )


def _metafile(*, compressed: bool = False, file: str = "LOCAL") -> bytes:
    content = zlib.compress(_PIXELS) if compressed else _PIXELS
    text = (
        "ObjectType = Image\nNDims = 3\nDimSize = 4 3 3\nElementType = MET_UCHAR\n"
        f"CompressedData = {compressed}\nUltrasoundImageOrientation = UFD\n"
        f"{_frames(' = ')}ElementDataFile = {file}\n"
    )
    return text.encode() + (content if file == "LOCAL" else b"")


def _nrrd(*, compressed: bool) -> bytes:
    content = gzip.compress(_PIXELS, mtime=0) if compressed else _PIXELS
    text = (
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 3 3\nkinds: domain domain list\n"
        f"encoding: {'gz' if compressed else 'raw'}\nultrasound image orientation:=MFA\n"
        f"{_frames(':=')}\n"
    )
    return text.encode() + content


PARSERS = (
    FuzzedParser(
        "images_mha",
        "x.igs.mha",
        _read_images,
        lambda: [_metafile(), _metafile(compressed=True)],
        (*TEXT, *RAW),
    ),
    FuzzedParser(
        "images_mhd",
        "x.igs.mhd",
        _read_images,
        lambda: [_metafile(file="x.raw")],
        TEXT,
        {"x.raw": _PIXELS},
    ),
    FuzzedParser(
        "images_nrrd",
        "x.igs.nrrd",
        _read_images,
        lambda: [_nrrd(compressed=False), _nrrd(compressed=True)],
        (*TEXT, *NRRD),
    ),
)
