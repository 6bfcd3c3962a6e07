"""Description of a recording."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.file_info.file_info import FileInfo
from app.cli.file_info.images import add_images, describe_images_alone

if TYPE_CHECKING:
    from app.case import RecordingInventory


def describe(path: Path, package_dirs: Sequence[Path]) -> FileInfo:
    """Read the whole recording at ``path`` and count its content."""
    return describe_at_rate(path, None)


def describe_at_rate(path: Path, rate_hz: float | None) -> FileInfo:
    """Describe a recording; ``rate_hz`` is that of frames without times."""
    from app.case import RecordingInventory, read_recording
    from app.case.readers.recording_format import format_of, note_to
    from app.cli.progress import with_progress
    from app.session import REFERENCE

    alone = describe_images_alone(path)
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
        f"a recording of a tracker ({_kind(path, recording_format.kinds)})",
        facts,
        tuple(uses),
        tuple(missing),
        tuple(notes),
    )
    return add_images(path, found)


def _kind(path: Path, kinds: tuple[str, ...]) -> str:
    """The ending of ``path``, or the kind of folder."""
    return next((kind for kind in kinds if path.name.lower().endswith(kind)), kinds[-1])


def _rate(inventory: "RecordingInventory") -> str:
    if inventory.frames < 2 or inventory.duration_s <= 0.0:
        return ""
    return f", {(inventory.frames - 1) / inventory.duration_s:.1f} Hz on average"
