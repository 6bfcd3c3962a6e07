"""List the ultrasound images of an IGSIO sequence: time, status, checksum, and place in a frame.

Each line has the number of the image, its time, its status and the SHA-256 of its pixels, row by
row in the orientation MF (16 bits: low byte first). With --calibration it has the four corners of
the image, too, in mm: the centres of its first pixel, of the end of its first row, of its last
pixel and of the start of its last row. An image without a valid pose has a reason instead.
igtl://HOST:PORT lists the images that an OpenIGTLink server sends, by their own matrix. --serve
sends those of a recording to one OpenIGTLink client, in their pace. Exit status: 0; 2 on bad input.
"""

import argparse
import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.options import add_json

if TYPE_CHECKING:
    from collections.abc import Iterator

    from app.case import ImageSequence
    from app.geometry import ImageCalibration, ImageSample

_IGTL = "igtl://"
_HOST = "127.0.0.1"
_IMAGE = "Image"

SUMMARY = "list the images of an ultrasound recording, with their corners in a frame"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard images``."""
    parser.add_argument(
        "sequence", metavar="SEQUENCE",
        help="recording with images (.igs.mha, .igs.mhd, .igs.nrrd, .igs.nhdr), or "
        "igtl://HOST:PORT",
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
    parser.add_argument(
        "--serve", type=int, metavar="PORT",
        help="send the images that have a place to one OpenIGTLink client of this machine, as "
        "IMAGE; needs --calibration",
    )  # fmt: skip
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Print one line for each image; with --json one object for each line."""
    from app.case import ImageSequence, read_image_calibration
    from app.geometry import InputError

    if options.sequence.startswith(_IGTL):
        return _receive(options)
    calibration = (
        None
        if options.calibration is None
        else read_image_calibration(options.calibration, options.probe)
    )
    with ImageSequence(Path(options.sequence), options.orientation) as sequence:
        if options.serve is not None:
            if calibration is None:
                raise InputError("--serve is given without --calibration; expected both")
            return _serve(sequence, calibration, options)
        for number in range(len(sequence)):
            found = _described(sequence, number, calibration, options.frame)
            print(json.dumps(found) if options.json else _as_text(found))
    return 0


def _receive(options: argparse.Namespace) -> int:
    """Print the images of a server until it closes the connection."""
    from app.geometry import InputError, image_corners
    from app.igtl import receive_images
    from app.igtl.wire import Refusals

    host, _, port = options.sequence.removeprefix(_IGTL).rpartition(":")
    if not (port.isascii() and port.isdigit() and 0 < int(port) < 1 << 16 and host):
        raise InputError(f"{options.sequence[:60]!r}: no address; expected igtl://HOST:PORT")
    refusals = Refusals()
    for received in receive_images(host, int(port), refusals):
        image = received.image
        found = _facts(image)
        found["frame"] = received.device
        found["corners_mm"] = image_corners(received.matrix, *(image.size or (1, 1))).tolist()
        print(json.dumps(found) if options.json else _as_text(found), flush=True)
    if refusals.last:
        raise InputError(f"{sum(refusals.counts.values())} messages refused: {refusals.last}")
    return 0


def _serve(
    sequence: "ImageSequence", calibration: "ImageCalibration", options: argparse.Namespace
) -> int:
    """Send the images that have a place to the first client."""
    import socket

    from app.geometry import InputError
    from app.igtl import image_message, send_images

    def packets() -> "Iterator[tuple[int, bytes]]":
        for image in sequence:
            pose = sequence.pose(image.number, calibration, options.frame)
            if pose.matrix is not None and image.stamp is not None:
                device = f"{_IMAGE}_{options.frame}"
                yield image.stamp.ns, image_message(device, image, pose.matrix)

    try:
        listener = socket.create_server((_HOST, options.serve))
    except (OSError, OverflowError) as error:
        raise InputError(f"--serve {options.serve}: {error}; expected a free port") from error
    with listener:
        sent = send_images(listener, packets())
    print(f"sent {sent} of {len(sequence)} images")
    return 0


def _described(
    sequence: "ImageSequence", number: int, calibration: "ImageCalibration | None", frame: str
) -> dict[str, Any]:
    from app.geometry import image_corners

    found = _facts(sequence.image(number))
    if calibration is not None:
        pose = sequence.pose(number, calibration, frame)
        found["frame"] = frame
        found["corners_mm"] = (
            None if pose.matrix is None else image_corners(pose.matrix, *sequence.size).tolist()
        )
        found["problem"] = pose.problem
    return found


def _facts(image: "ImageSample") -> dict[str, Any]:
    found: dict[str, Any] = {
        "image": image.number,
        "stamp_ns": None if image.stamp is None else image.stamp.ns,
        "status": image.status.name,
        "sha256": None,
    }
    if image.pixels is not None:
        content = image.pixels.astype(image.pixels.dtype.newbyteorder("<"), copy=False).tobytes()
        found["sha256"] = hashlib.sha256(content).hexdigest()
        found["shape"] = list(image.pixels.shape)
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
