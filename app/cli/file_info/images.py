"""Description of the images of a recording."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.file_info.file_info import FileInfo

if TYPE_CHECKING:
    from app.case import ImageHeader

_ENDINGS = (".igs.mha", ".igs.mhd", ".igs.nrrd", ".igs.nhdr")


def add_images(path: Path, found: FileInfo) -> FileInfo:
    """Return ``found`` with the facts of the images of an IGSIO sequence, where it has any."""
    from app.case import read_image_header
    from app.geometry import InputError

    if not path.name.lower().endswith(_ENDINGS):
        return found
    try:
        header = read_image_header(path)
        return _with_images(header, found)
    except InputError as error:
        return replace(found, missing=(*found.missing, f"its images cannot be read: {error}"))


def describe_images_alone(path: Path) -> FileInfo | None:
    """Describe a sequence of images without a pose; None for other files."""
    from app.case import read_image_header
    from app.geometry import InputError

    if not path.name.lower().endswith(_ENDINGS):
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
    from app.cli.progress import with_progress

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
        missing.append("the orientation of the images: --orientation of marginguard images")
    untimed = sum(entry.stamp is None for entry in header.entries)
    if untimed:
        missing.append(f"{untimed} images have no Timestamp: they have no place")
    unplaced = sum(not entry.poses for entry in header.entries)
    if unplaced:
        missing.append(f"{unplaced} images have no pose of a probe: they have no place")
    if header.spare:
        missing.append(f"{header.spare} frames have poses without an image")
    use = f"marginguard images {header.path} --calibration FILE: the place of each image"
    return replace(
        found,
        facts={**found.facts, **facts},
        uses=(*found.uses, use),
        missing=(*found.missing, *missing),
    )
