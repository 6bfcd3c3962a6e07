"""Description of a recording and of its images."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.file_info import FileInfo
from app.cli.progress import with_progress
from app.geometry import InputError

if TYPE_CHECKING:
    from app.case import ImageHeader, RecordingInventory


_IMAGE_ENDINGS = (".igs.mha", ".igs.mhd", ".igs.nrrd", ".igs.nhdr")


def describe_recording(
    path: Path, package_dirs: Sequence[Path] = (), rate_hz: float | None = None
) -> FileInfo:
    """Read the whole recording at ``path``; ``rate_hz`` is that of frames without times."""
    from app.case import RecordingInventory, read_recording
    from app.case.readers.recording_format import format_of, note_to
    from app.session import REFERENCE

    alone = _describe_images_alone(path)
    if alone is not None:
        return alone
    notes: list[str] = []
    inventory = RecordingInventory()
    frames = read_recording(path, note_to(notes), rate_hz=rate_hz)
    for frame in with_progress(frames, "reading frame"):
        inventory.add(frame)
    edges = inventory.edges
    facts = {"frames": f"{inventory.frames} in {inventory.duration_s:.3f} s{_rate(inventory)}"}
    for number, edge in enumerate(edges, start=1):
        statuses = ", ".join(f"{count} {status.name}" for status, count in edge.statuses.items())
        facts[f"transform {number}"] = f"{edge.target} -> {edge.source}: {statuses}"
    usable = {edge.source for edge in edges if edge.valid}
    tools = sorted(usable - {REFERENCE})
    recording_format = format_of(path)
    uses = [f"recording.path of a case.yaml, with tool.frame one of {', '.join(tools)}"]
    uses += [f"marginguard calibrate pivot {path} --tool {tool}" for tool in tools[:4]]
    missing = ["a case needs the meshes of a tool and of a tumour (marginguard tumor)"]
    if REFERENCE not in usable:
        missing.append(
            f"no frame {REFERENCE!r}: the tumour's frame must be another tracked one, and a robot "
            "cannot be registered"
        )
    if recording_format.has_joints:
        missing.append("joints are read with a case.yaml that names their topic")
    else:
        missing.append(
            "this format holds no joints: a robot can follow the tool, but nothing checks it"
        )
    if not usable:
        uses = []
        missing.insert(0, "no transform is valid in any frame")
    found = FileInfo(
        str(path),
        f"a recording of a tracker ({_ending(path, recording_format.kinds)})",
        facts,
        tuple(uses),
        tuple(missing),
        tuple(notes),
    )
    return _add_images(path, found)


def _ending(path: Path, kinds: tuple[str, ...]) -> str:
    """The ending of ``path``, or the kind of folder."""
    return next((kind for kind in kinds if path.name.lower().endswith(kind)), kinds[-1])


def _rate(inventory: "RecordingInventory") -> str:
    if inventory.frames < 2 or inventory.duration_s <= 0.0:
        return ""
    return f", {(inventory.frames - 1) / inventory.duration_s:.1f} Hz on average"


def _add_images(path: Path, found: FileInfo) -> FileInfo:
    """Return ``found`` with the facts of the images of an IGSIO sequence, where it has any."""
    from app.case import read_image_header

    if not path.name.lower().endswith(_IMAGE_ENDINGS):
        return found
    try:
        header = read_image_header(path)
        return _with_images(header, found)
    except InputError as error:
        return replace(found, missing=(*found.missing, f"its images cannot be read: {error}"))


def _describe_images_alone(path: Path) -> FileInfo | None:
    """Describe a sequence of images without a pose; None for other files."""
    from app.case import read_image_header

    if not path.name.lower().endswith(_IMAGE_ENDINGS):
        return None
    try:
        header = read_image_header(path)
    except InputError:
        return None  # the reader of recordings reports it
    if header.layout is None or any(entry.poses for entry in header.entries) or header.spare:
        return None
    return _with_images(
        header, FileInfo(str(path), "images without tracking", {}, notes=header.notes)
    )


def _with_images(header: "ImageHeader", found: FileInfo) -> FileInfo:
    """Read all images and add what they are; `InputError` where they cannot be read."""
    from app.case import ImageSequence

    if header.layout is None:
        return found
    layout = header.layout
    with ImageSequence(header.path, layout.orientation or "MF") as sequence:
        statuses = Counter(
            image.status.name for image in with_progress(iter(sequence), "reading image")
        )
        columns, rows = sequence.size
    bits = "8" if layout.dtype.endswith("1") else "16"
    colour = "RGB" if layout.channels == 3 else "grey"
    facts = {
        "images": f"{layout.count} of {columns} x {rows} pixels, {bits} bits, {colour}",
        "image status": ", ".join(f"{count} {name}" for name, count in statuses.items()),
        "orientation": layout.orientation or "not stated",
    }
    missing = []
    if layout.orientation is None:
        missing.append("the orientation of the images: --orientation of marginguard info images")
    untimed = sum(entry.stamp is None for entry in header.entries)
    if untimed:
        missing.append(f"{untimed} images have no Timestamp: they have no place")
    unplaced = sum(not entry.poses for entry in header.entries)
    if unplaced:
        missing.append(f"{unplaced} images have no pose of a probe: they have no place")
    if header.spare:
        missing.append(f"{header.spare} frames have poses without an image")
    use = f"marginguard info images {header.path} --calibration FILE: the place of each image"
    return replace(
        found,
        facts={**found.facts, **facts},
        uses=(*found.uses, use),
        missing=(*found.missing, *missing),
    )
