"""A recording, with or without a case around it, and the poses of one tool in it."""

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from app.case import (
    MRML_ENDINGS,
    Case,
    TrackingFrame,
    open_case,
    read_igsio,
    read_mcap,
    read_mrml,
)
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    InputError,
    TrackedTransform,
    TrackingStatus,
    Transform,
)
from app.registration import usable_poses
from app.session import REFERENCE, PoseTree, with_estimated_clock

FROZEN_AFTER_NS = 1000 * NS_PER_MS
"""A tool whose pose repeats itself digit for digit for longer is not measured any more."""

_IGSIO_ENDINGS = (".igs.mha", ".igs.nrrd")


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Frames of a recording, or of a part of it; ``case`` where it belongs to one."""

    path: Path
    frames: tuple[TrackingFrame, ...]
    case: Case | None
    notes: tuple[str, ...]

    @property
    def edges(self) -> tuple[tuple[str, str], ...]:
        """(target, source) of every measured transform, in the order of their appearance."""
        return tuple(
            dict.fromkeys(
                (pose.target, pose.source) for frame in self.frames for pose in frame.poses
            )
        )


@dataclass(frozen=True, slots=True, eq=False)
class ToolTrack:
    """The good poses ``reference_from_tool`` (stamps rising), and how many frames gave none."""

    tool: str
    reference: str
    samples: tuple[TrackedTransform, ...]
    notes: tuple[str, ...]

    @property
    def poses(self) -> tuple[Transform, ...]:
        """The transforms alone."""
        return usable_poses(self.samples)


@dataclass(frozen=True, slots=True)
class Span:
    """A part of a recording, in seconds from its first frame."""

    from_s: float = -math.inf
    to_s: float = math.inf

    def of(self, frames: Iterable[TrackingFrame]) -> tuple[TrackingFrame, ...]:
        """The frames within; `InputError` when there is none."""
        start_ns: int | None = None
        kept = []
        seconds = 0.0
        for frame in frames:
            start_ns = frame.stamp.ns if start_ns is None else start_ns
            seconds = (frame.stamp.ns - start_ns) / NS_PER_S
            if self.from_s <= seconds <= self.to_s:
                kept.append(frame)
        if not kept:
            raise InputError(
                f"no frame is within {self.from_s:g} and {self.to_s:g} s: "
                f"the recording ends at {seconds:g} s"
            )
        return tuple(kept)


def open_recording(path: Path, span: Span, *, package_dirs: Iterable[Path] = ()) -> Recording:
    """Read an IGSIO, MRML or MCAP file, a rosbag2 folder, or the recording of a case folder.

    Joints come with a case only, on the tracker's clock (estimated where the case asks for it).
    """
    if (path / "case.yaml").is_file():
        case, _ = with_estimated_clock(open_case(path, package_dirs=tuple(package_dirs)))
        frames = span.of(case.recorded_frames())
        return Recording(path, frames, case, case.notes())
    notes: list[str] = []
    if path.name.lower().endswith(_IGSIO_ENDINGS):
        read = read_igsio(path, notes.append)
    elif path.name.lower().endswith(MRML_ENDINGS):
        read = read_mrml(path, notes.append)
    elif path.is_dir() or path.name.lower().endswith(".mcap"):
        read = read_mcap(path, notes.append, joint_states_topic=None)
    else:
        raise InputError(
            f"{path} is no recording: a case folder, .igs.mha, .igs.nrrd, .mrb, .mrml, .mcap or a "
            "rosbag2 folder wanted"
        )
    return Recording(path, span.of(read), None, tuple(notes))


def follow_tool(
    recording: Recording, *, tool: str | None, reference: str | None, max_age_ms: float = 0.0
) -> ToolTrack:
    """The poses of ``tool`` in ``reference``, along whatever edges were measured.

    Without ``tool`` it is the case's, or the only one there is; without ``reference`` it is the
    frame of that name where there is one, else the one in which the tool was measured. Samples
    that make one pose are at most ``max_age_ms`` apart in time. Raises `InputError`, with the
    frames that there are, when the choice is not clear or nothing good is left.
    """
    tool = tool or _only_tool(recording, reference)
    _check_known(tool, recording, "--tool")
    reference = reference or _default_reference(recording, tool)
    _check_known(reference, recording, "--reference")
    if reference == tool:
        raise InputError(f"--reference is {tool!r}, the tool itself: another frame wanted")
    tree = PoseTree(round(max_age_ms * NS_PER_MS), FROZEN_AFTER_NS, (tool,))
    samples: list[TrackedTransform] = []
    lost: Counter[str] = Counter()
    for frame in recording.frames:
        tree.insert(frame)
        found = tree.pose(reference, tool)
        if found.transform is None or found.oldest is None:
            lost.update(sorted(found.problems))
        elif not samples or samples[-1].stamp.ns != found.oldest.ns:
            samples.append(TrackedTransform(found.transform, found.oldest, TrackingStatus.OK))
    reasons = ", ".join(f"{count} {reason}" for reason, count in lost.most_common())
    if not samples:
        raise InputError(
            f"{recording.path} holds no good pose of {tool!r} in {reference!r}: {reasons}"
        )
    without = len(recording.frames) - len(samples)
    notes = (f"{without} of {len(recording.frames)} frames left out: {reasons}",) if lost else ()
    return ToolTrack(tool, reference, tuple(samples), (*recording.notes, *notes))


def _only_tool(recording: Recording, reference: str | None) -> str:
    if recording.case is not None:
        return recording.case.manifest.tool.frame
    others = (REFERENCE, reference)
    tools = [source for _, source in recording.edges if source not in others]
    if len(tools) != 1:
        raise InputError(
            f"--tool is wanted: {recording.path} has {', '.join(tools) or 'no tracked tool'}"
        )
    return tools[0]


def _default_reference(recording: Recording, tool: str) -> str:
    frames = _frames(recording)
    if REFERENCE in frames and tool != REFERENCE:
        return REFERENCE
    return next((target for target, source in recording.edges if source == tool), frames[0])


def _check_known(frame: str, recording: Recording, option: str) -> None:
    frames = _frames(recording)
    if frame not in frames:
        raise InputError(f"{option} {frame!r} is not in {recording.path}: {', '.join(frames)} are")


def _frames(recording: Recording) -> tuple[str, ...]:
    return tuple(dict.fromkeys(frame for edge in recording.edges for frame in edge))
