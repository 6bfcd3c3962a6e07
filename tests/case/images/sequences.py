"""Writers of IGSIO sequences with images, for tests; pixels are the values that a test states."""

import gzip
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Values = NDArray[np.integer[Any]]

CALIBRATION = np.array(
    [
        [-0.0016, 0.0786, -0.008, 15.4],
        [-0.0839, 0.0037, 0.0154, 49.6],
        [0.0159, 0.0071, 0.0804, -8.6],
    ]
)
"""ImageToProbe, (3, 4): pixels of 0.085 x 0.079 mm, axes 3 degrees from a right angle."""
PROBE_FROM_IMAGE = np.vstack([CALIBRATION, (0, 0, 0, 1)])
"""The same matrix as (4, 4)."""


def some_pixels(
    count: int = 5, rows: int = 6, columns: int = 7, kind: str = "uint8", channels: int = 1
) -> Values:
    """Random values (count, rows, columns) or (count, rows, columns, 3), the same in each run."""
    shape = (count, rows, columns, 3)[: 4 if channels == 3 else 3]
    limits = np.iinfo(kind)
    rng = np.random.default_rng(7)
    return rng.integers(limits.min, limits.max, shape, dtype=kind, endpoint=True)


def frame_fields(
    count: int, *, start_s: float = 100.0, period_s: float = 0.1, **changes: str
) -> dict[str, str]:
    """Header fields of ``count`` frames with ProbeToTracker and ReferenceToTracker."""
    rng = np.random.default_rng(2)
    found = {}
    for n in range(count):
        for name in ("Probe", "Reference"):
            matrix = np.eye(4)
            matrix[:3, :3] = Rotation.random(rng=rng).as_matrix()
            matrix[:3, 3] = rng.normal(0.0, 200.0, 3)
            key = f"Seq_Frame{n:04d}_{name}ToTrackerTransform"
            found[key] = " ".join(f"{value:.9g}" for value in matrix.ravel())
            found[f"{key}Status"] = "OK"
        found[f"Seq_Frame{n:04d}_Timestamp"] = f"{start_s + period_s * n:.6f}"
        found[f"Seq_Frame{n:04d}_ImageStatus"] = "OK"
    return dict(sorted({**found, **changes}.items(), key=lambda item: item[0][:13]))


def with_probe(
    recording: str, poses: Iterable[NDArray[Any]], *, lost: int = -1, invalid: int = -1
) -> dict[str, str]:
    """Fields of ``recording`` with a pose of the probe and an image in each frame.

    The probe is out of view in the frame ``lost``, and the image ``invalid`` is marked so.
    """
    lines = (line.partition(" = ") for line in recording.splitlines())
    fields = {key: value for key, _, value in lines if key.startswith("Seq_")}
    for index, pose in enumerate(poses):
        frame = f"Seq_Frame{index:04}_"
        numbers = " ".join(f"{value:.9g}" for value in pose.ravel())
        fields[f"{frame}ProbeToTrackerTransform"] = numbers
        status = "OUT_OF_VIEW" if index == lost else "OK"
        fields[f"{frame}ProbeToTrackerTransformStatus"] = status
        fields[f"{frame}ImageStatus"] = "INVALID" if index == invalid else "OK"
    return dict(sorted(fields.items(), key=lambda item: item[0][:13]))


_MET = {"uint8": "MET_UCHAR", "int8": "MET_CHAR", "uint16": "MET_USHORT", "int16": "MET_SHORT"}


def write_metafile(
    path: Path,
    pixels: Values,
    *,
    compressed: bool = False,
    big_endian: bool = False,
    orientation: str | None = "MFA",
    fields: dict[str, str] | None = None,
    header: dict[str, str] | None = None,
) -> Path:
    """Write ``.igs.mha``, or ``.igs.mhd`` with its pixels in a second file, as PLUS lays it out."""
    stored = pixels.astype(pixels.dtype.newbyteorder(">" if big_endian else "<")).tobytes()
    content = zlib.compress(stored) if compressed else stored
    data_name = path.name.removesuffix(".igs.mhd") + (".zraw" if compressed else ".raw")
    lines = {
        "ObjectType": "Image",
        "NDims": "3",
        "BinaryData": "True",
        "BinaryDataByteOrderMSB": str(big_endian),
        "CompressedData": str(compressed),
        **({"CompressedDataSize": str(len(content))} if compressed else {}),
        "ElementSpacing": "1 1 1",
        "DimSize": f"{pixels.shape[2]} {pixels.shape[1]} {pixels.shape[0]}",
        "ElementType": _MET[pixels.dtype.name],
        **({"ElementNumberOfChannels": "3"} if pixels.ndim == 4 else {}),
        **({"UltrasoundImageOrientation": orientation} if orientation else {}),
        "UltrasoundImageType": "RGB_COLOR" if pixels.ndim == 4 else "BRIGHTNESS",
        **(frame_fields(len(pixels)) if fields is None else fields),
        **(header or {}),
        "ElementDataFile": "LOCAL" if path.suffix == ".mha" else data_name,
    }
    text = "".join(f"{key} = {value}\n" for key, value in lines.items()).encode()
    if path.suffix == ".mha":
        path.write_bytes(text + content)
    else:
        path.write_bytes(text)
        (path.parent / data_name).write_bytes(content)
    return path


def write_nrrd(path: Path, pixels: Values, *, compressed: bool = False) -> Path:
    """Write ``.igs.nrrd`` with the fields and kinds of PLUS."""
    colour = pixels.ndim == 4
    sizes = [*([3] if colour else []), pixels.shape[2], pixels.shape[1], len(pixels)]
    lines = [
        "NRRD0004",
        f"type: {pixels.dtype.name}",
        f"dimension: {len(sizes)}",
        f"sizes: {' '.join(map(str, sizes))}",
        f"kinds: {'vector ' if colour else ''}domain domain list",
        f"encoding: {'gz' if compressed else 'raw'}",
        "endian: little",
        "ultrasound image orientation:=MFA",
        *(f"{key}:={value}" for key, value in frame_fields(len(pixels)).items()),
    ]
    content = gzip.compress(pixels.tobytes()) if compressed else pixels.tobytes()
    path.write_bytes("\n".join(lines).encode() + b"\n\n" + content)
    return path
