"""List the ultrasound images of an IGSIO sequence: time, status, checksum, and place in a frame.

Each line has the number of the image, its time, its status and the SHA-256 of its pixels, row by
row in the orientation MF (16 bits: low byte first). With --calibration it has the four corners of
the image, too, in mm: the centres of its first pixel, of the end of its first row, of its last
pixel and of the start of its last row. An image without a valid pose has a reason instead. Exit
status: 0; 2 on bad input.
"""

import argparse
import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.options import add_json

if TYPE_CHECKING:
    from app.case import ImageSequence
    from app.geometry import ImageCalibration

SUMMARY = "list the images of an ultrasound recording, with their corners in a frame"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard images``."""
    parser.add_argument(
        "sequence", type=Path, metavar="SEQUENCE",
        help="recording with images (.igs.mha, .igs.mhd, .igs.nrrd, .igs.nhdr)",
    )  # fmt: skip
    parser.add_argument(
        "--calibration", type=Path, metavar="FILE",
        help="ImageToProbe: a configuration of PLUS (.xml) or a transform file",
    )  # fmt: skip
    parser.add_argument(
        "--probe", default="probe", metavar="FRAME", help="tracked frame of the probe (%(default)s)"
    )
    parser.add_argument(
        "--frame", default="reference", metavar="FRAME",
        help="frame of the corners (%(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--orientation", metavar="LETTERS",
        help="orientation of images whose header names none, such as MF or UF",
    )  # fmt: skip
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Print one line for each image; with --json one object for each line."""
    from app.case import ImageSequence, read_image_calibration

    calibration = (
        None
        if options.calibration is None
        else read_image_calibration(options.calibration, options.probe)
    )
    with ImageSequence(options.sequence, options.orientation) as sequence:
        for number in range(len(sequence)):
            found = _described(sequence, number, calibration, options.frame)
            print(json.dumps(found) if options.json else _as_text(found))
    return 0


def _described(
    sequence: "ImageSequence", number: int, calibration: "ImageCalibration | None", frame: str
) -> dict[str, Any]:
    from app.geometry import image_corners

    image = sequence.image(number)
    found: dict[str, Any] = {
        "image": number,
        "stamp_ns": None if image.stamp is None else image.stamp.ns,
        "status": image.status.name,
        "sha256": None,
    }
    if image.pixels is not None:
        content = image.pixels.astype(image.pixels.dtype.newbyteorder("<"), copy=False).tobytes()
        found["sha256"] = hashlib.sha256(content).hexdigest()
        found["shape"] = list(image.pixels.shape)
    if calibration is not None:
        pose = sequence.pose(number, calibration, frame)
        found["frame"] = frame
        found["corners_mm"] = (
            None if pose.matrix is None else image_corners(pose.matrix, *sequence.size).tolist()
        )
        found["problem"] = pose.problem
    return found


def _as_text(found: dict[str, Any]) -> str:
    time = "no time" if found["stamp_ns"] is None else f"{found['stamp_ns'] / 1e9:.6f} s"
    parts = [f"{found['image']:5d}  {time}  {found['status']}", (found["sha256"] or "-")[:12]]
    if found.get("corners_mm"):
        corners = "  ".join(
            " ".join(f"{value:.3f}" for value in corner) for corner in found["corners_mm"]
        )
        parts.append(f"{corners} mm in {found['frame']}")
    elif found.get("problem"):
        parts.append(found["problem"])
    return "  ".join(parts)
