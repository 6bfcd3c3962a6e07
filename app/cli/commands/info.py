"""Describe a recorded case, or a file: what it is, what it can be used for, what is missing.

A case: frames, transforms with their statuses, joints, meshes. A file: a recording, a mesh, a
robot, a transform, a configuration of PLUS, points or a segmentation.
"""

import argparse
import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.case import recording_formats
from app.cli.options import CASE_HELP, add_json, add_package_dirs, input_argument, rate_hz
from app.cli.parsing import CommandParser
from app.cli.progress import with_progress
from app.files.bounded_io import is_file, is_folder
from app.geometry import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from app.case import ImageSequence
    from app.geometry import ImageCalibration, ImageSample


SUMMARY = "describe a case, a file that may become part of one, or ultrasound images"


def add_arguments(parser: CommandParser) -> None:
    """Declare the options of ``marginguard info``."""
    parser.add_argument(
        "path", type=input_argument, metavar="PATH", help=f"{CASE_HELP}; or any file"
    )
    add_package_dirs(parser)
    add_json(parser)
    parser.add_argument(
        "--rate-hz", type=rate_hz, metavar="HZ", help="rate of a recording without times"
    )
    _add_image_arguments(
        parser.add_subcommand(
            "images",
            _run_images,
            "list the images of an ultrasound recording, with their corners in a frame",
        )
    )


def run(options: argparse.Namespace) -> int:
    """Read the whole recording or file and print its description."""
    if not _is_case(options.path):
        return _describe_file(options)
    from app.case import open_case
    from app.session import with_repaired_meshes

    case = with_repaired_meshes(open_case(options.path, package_dirs=options.package_dirs))
    found = describe(case)
    print(json.dumps(found, indent=2) if options.json else as_text(found))
    return 0


def _is_case(path: Path) -> bool:
    """True for a folder with a case.yaml, and for a path that only a case can explain."""
    if is_file(path / "case.yaml"):
        return True
    return not is_file(path) and not (
        is_folder(path) and any(each.recognises(path) for each in recording_formats())
    )


def _describe_file(options: argparse.Namespace) -> int:
    from app.cli.file_info import describe_file
    from app.cli.recording_info import describe_recording

    found = (
        describe_file(options.path, options.package_dirs)
        if options.rate_hz is None
        else describe_recording(options.path, rate_hz=options.rate_hz)
    )
    print(json.dumps(asdict(found), indent=2) if options.json else found.as_text())
    return 0


def describe(case: Any) -> dict[str, Any]:
    """Describe ``case`` with values that JSON can hold."""
    from app.case import RecordingInventory

    inventory = RecordingInventory()
    for frame in with_progress(case.frames(), "reading frame"):
        inventory.add(frame)
    manifest = case.manifest
    tool = manifest.tool
    meshes = {"tumor": case.tumor_mesh()}
    if tool.mesh is not None:
        meshes["tool"] = case.tool_mesh()
    return {
        "name": manifest.name,
        "provenance": asdict(manifest.provenance),
        "recording": manifest.recorded().path,
        "frames": inventory.frames,
        "silences": inventory.silences,
        "duration_s": inventory.duration_s,
        "transforms": [
            {
                "target": edge.target,
                "source": edge.source,
                "samples": edge.samples,
                "statuses": {status.name: count for status, count in edge.statuses.items()},
            }
            for edge in inventory.edges
        ],
        "joint_samples": inventory.joint_samples,
        "joints": list(inventory.joint_names),
        "meshes": {
            name: {
                "triangles": len(mesh.faces),
                "size_mm": (mesh.bounds_mm[1] - mesh.bounds_mm[0]).round(3).tolist(),
                "volume_mm3": round(mesh.signed_volume_mm3, 3),
            }
            for name, mesh in meshes.items()
        },
        "tool": tool.frame,
        "tumor": manifest.tumor.frame,
        "robot": None if manifest.robot is None else manifest.robot.urdf,
        "registration": None if manifest.registration is None else manifest.registration.method,
        "notes": list(case.notes()),
    }


def as_text(found: dict[str, Any]) -> str:
    """Format the description as lines of text."""
    lines = [
        found["name"],
        f"  provenance     {found['provenance']['kind']}: {found['provenance']['source']}",
        f"  recording      {found['recording']}",
        f"  frames         {_frames(found)}",
    ]
    for edge in found["transforms"]:
        statuses = ", ".join(f"{count} {name}" for name, count in edge["statuses"].items())
        lines.append(f"  transform      {edge['target']} -> {edge['source']}: {statuses}")
    lines.append(
        f"  joints         {found['joint_samples']} samples of {', '.join(found['joints'])}"
        if found["joint_samples"]
        else "  joints         none"
    )
    for name, mesh in found["meshes"].items():
        size = " x ".join(f"{length:.1f}" for length in mesh["size_mm"])
        lines.append(
            f"  {name + ' mesh':<14} {mesh['triangles']} triangles, {size} mm, "
            f"{mesh['volume_mm3']:.0f} mm3"
        )
    lines += [
        f"  tool           {found['tool']}",
        f"  tumour         rigid to {found['tumor']}",
        f"  robot          {found['robot'] or 'none'}",
        f"  registration   {found['registration'] or 'none'}",
        *(f"  note           {note}" for note in found["notes"]),
    ]
    return "\n".join(lines)


def _frames(found: dict[str, Any]) -> str:
    recorded, silences = found["frames"], found["silences"]
    text = f"{recorded} in {found['duration_s']:.3f} s, silences: {silences}"
    # A replay inserts a frame without poses into each silence.
    return f"{text}, so a replay has {recorded + silences} frames" if silences else text


_IGTL = "igtl://"
_HOST = "127.0.0.1"
_IMAGE = "Image"


def _add_image_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard info images``."""
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


def _run_images(options: argparse.Namespace) -> int:
    """List the ultrasound images of an IGSIO sequence: time, status, checksum, and place in a
    frame.

    Each line has the number of the image, its time, its status and the SHA-256 of its pixels, row
    by row in the orientation MF (16 bits: low byte first). With --calibration it has the four
    corners of the image, too, in mm: the centres of its first pixel, of the end of its first row,
    of its last pixel and of the start of its last row. An image without a valid pose has a reason
    instead. igtl://HOST:PORT lists the images that an OpenIGTLink server sends, by their own
    matrix. --serve sends those of a recording to one OpenIGTLink client, in their pace. Exit
    status: 0; 2 on bad input.
    """
    from app.case import ImageSequence, read_image_calibration

    if options.sequence.startswith(_IGTL):
        return _receive_images(options)
    calibration = (
        None
        if options.calibration is None
        else read_image_calibration(options.calibration, options.probe)
    )
    with ImageSequence(Path(options.sequence), options.orientation) as sequence:
        if options.serve is not None:
            if calibration is None:
                raise InputError("--serve is given without --calibration; expected both")
            return _serve_images(sequence, calibration, options)
        for number in range(len(sequence)):
            found = _placed_image(sequence, number, calibration, options.frame)
            print(json.dumps(found) if options.json else _image_line(found))
    return 0


def _receive_images(options: argparse.Namespace) -> int:
    """Print the images of a server until it closes the connection."""
    from app.geometry import InputError, image_corners
    from app.igtl import receive_images
    from app.igtl.framing import Refusals

    host, _, port = options.sequence.removeprefix(_IGTL).rpartition(":")
    if not (port.isascii() and port.isdigit() and 0 < int(port) < 1 << 16 and host):
        raise InputError(f"{options.sequence[:60]!r}: no address; expected igtl://HOST:PORT")
    refusals = Refusals()
    for received in receive_images(host, int(port), refusals):
        image = received.image
        found = _image(image)
        found["frame"] = received.device
        found["corners_mm"] = image_corners(received.matrix, *(image.size or (1, 1))).tolist()
        print(json.dumps(found) if options.json else _image_line(found), flush=True)
    if refusals.last:
        raise InputError(f"{sum(refusals.counts.values())} messages refused: {refusals.last}")
    return 0


def _serve_images(
    sequence: "ImageSequence", calibration: "ImageCalibration", options: argparse.Namespace
) -> int:
    """Send the images that have a place to the first client."""
    import socket

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


def _placed_image(
    sequence: "ImageSequence", number: int, calibration: "ImageCalibration | None", frame: str
) -> dict[str, Any]:
    from app.geometry import image_corners

    found = _image(sequence.image(number))
    if calibration is not None:
        pose = sequence.pose(number, calibration, frame)
        found["frame"] = frame
        found["corners_mm"] = (
            None if pose.matrix is None else image_corners(pose.matrix, *sequence.size).tolist()
        )
        found["problem"] = pose.problem
    return found


def _image(image: "ImageSample") -> dict[str, Any]:
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


def _image_line(found: dict[str, Any]) -> str:
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
