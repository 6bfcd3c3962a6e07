"""Inputs of a calibration method, from files: frames, the track of one tool, the tool's tip."""

import argparse
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from app.case import Case, TrackingFrame, open_case, read_recording
from app.files import PlusConfiguration, read_plus_config, read_transform
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    FreshnessLimits,
    InputError,
    TrackedTransform,
    TrackingStatus,
    Transform,
)
from app.registration import usable_poses
from app.session import REFERENCE, PoseRules, PoseTree, with_estimated_clock

FROZEN_AFTER_NS = 1000 * NS_PER_MS
"""A tool whose pose is bitwise constant for longer than this is taken as no longer measured."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Frames of a recording or of a part of it. ``case`` is None without a case folder."""

    path: Path
    frames: tuple[TrackingFrame, ...]
    case: Case | None
    notes: tuple[str, ...]

    @property
    def edges(self) -> tuple[tuple[str, str], ...]:
        """(target, source) of every measured transform, in order of first appearance."""
        return tuple(
            dict.fromkeys(
                (pose.target, pose.source) for frame in self.frames for pose in frame.poses
            )
        )


@dataclass(frozen=True, slots=True, eq=False)
class ToolTrack:
    """Valid poses ``reference_from_tool``, in order of their stamps.

    ``notes`` are warnings of the reader, and the number of frames without a valid pose.
    """

    tool: str
    reference: str
    samples: tuple[TrackedTransform, ...]
    notes: tuple[str, ...]

    @property
    def poses(self) -> tuple[Transform, ...]:
        """The transforms without their stamps."""
        return usable_poses(self.samples)


@dataclass(frozen=True, slots=True)
class TimeSpan:
    """A closed interval of a recording, in seconds from its first frame."""

    from_s: float = -math.inf
    to_s: float = math.inf

    def select(self, frames: Iterable[TrackingFrame]) -> tuple[TrackingFrame, ...]:
        """Return the frames within the interval; raise `InputError` if there is none."""
        start_ns: int | None = None
        selected = []
        seconds = 0.0
        for frame in frames:
            start_ns = frame.stamp.ns if start_ns is None else start_ns
            seconds = (frame.stamp.ns - start_ns) / NS_PER_S
            if self.from_s <= seconds <= self.to_s:
                selected.append(frame)
        if not selected:
            raise InputError(
                f"no frame between {self.from_s:g} and {self.to_s:g} s; "
                f"expected a part of the recording, which ends at {seconds:g} s"
            )
        return tuple(selected)


def open_recording(
    path: Path,
    span: TimeSpan,
    *,
    package_dirs: Iterable[Path] = (),
    rate_hz: float | None = None,
) -> Recording:
    """Read a recording in any of the formats of `app.case`, or the recording of a case folder.

    Joints are read only for a case folder. Their stamps are on the tracker's clock; the offset is
    estimated if the case sets ``clock.estimate``. ``rate_hz`` is that of a recording without times;
    a case states it itself. Raises `InputError` for another kind of file.
    """
    if (path / "case.yaml").is_file():
        if rate_hz is not None:
            raise InputError(
                f"--rate-hz is {rate_hz:g} for a case; expected recording.rate_hz in its case.yaml"
            )
        case, _ = with_estimated_clock(open_case(path, package_dirs=tuple(package_dirs)))
        frames = span.select(case.recorded_frames())
        return Recording(path, frames, case, case.notes())
    notes: list[str] = []
    frames = span.select(read_recording(path, notes.append, rate_hz=rate_hz))
    return Recording(path, frames, None, tuple(notes))


def extract_tool_track(
    recording: Recording, *, tool: str | None, reference: str | None, max_age_ms: float = 0.0
) -> ToolTrack:
    """Return the poses of ``tool`` in ``reference``, composed of the measured transforms.

    ``tool`` defaults to the case's tool, else to the only tracked tool. ``reference`` defaults to
    the frame ``reference`` if it was tracked, else to the frame in which the tool was measured.
    Samples that are combined into one pose are at most ``max_age_ms`` apart. Raises `InputError`
    if a frame is unknown, the default is ambiguous or no valid pose is left.
    """
    tool = tool or _only_tool(recording, reference)
    _check_known(tool, recording, "--tool")
    reference = reference or _default_reference(recording, tool)
    _check_known(reference, recording, "--reference")
    if reference == tool:
        raise InputError(f"--reference is {tool!r}, the tool itself; expected another frame")
    limits = FreshnessLimits(round(max_age_ms * NS_PER_MS), FROZEN_AFTER_NS)
    tree = PoseTree(PoseRules(limits, (tool,)))
    samples: list[TrackedTransform] = []
    unusable: Counter[str] = Counter()
    for frame in recording.frames:
        tree.insert(frame)
        result = tree.pose(reference, tool)
        if result.transform is None or result.oldest is None:
            unusable.update(sorted(result.problems))
        elif not samples or samples[-1].stamp.ns != result.oldest.ns:
            samples.append(TrackedTransform(result.transform, result.oldest, TrackingStatus.OK))
    reasons = ", ".join(f"{count} {reason}" for reason, count in unusable.most_common())
    if not samples:
        raise InputError(
            f"{recording.path}: no valid pose of {tool!r} in {reference!r} ({reasons}); "
            "expected at least 1"
        )
    skipped = len(recording.frames) - len(samples)
    notes = (
        (f"{skipped} of {len(recording.frames)} frames left out: {reasons}",) if unusable else ()
    )
    return ToolTrack(tool, reference, tuple(samples), (*recording.notes, *notes))


def _only_tool(recording: Recording, reference: str | None) -> str:
    if recording.case is not None:
        return recording.case.manifest.tool.frame
    references = (REFERENCE, reference)
    tools = [source for _, source in recording.edges if source not in references]
    if len(tools) != 1:
        raise InputError(
            f"--tool is missing; expected one of the tracked tools of {recording.path}: "
            f"{', '.join(tools) or 'none'}"
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
        raise InputError(
            f"{option} {frame!r} is not in {recording.path}; expected one of {', '.join(frames)}"
        )


def _frames(recording: Recording) -> tuple[str, ...]:
    return tuple(dict.fromkeys(frame for edge in recording.edges for frame in edge))


def tip_frame_of(tool: str) -> str:
    """Name of the tip's frame: ``tool_tip`` for ``tool``."""
    return f"{tool}_tip"


def read_tip(
    recording: Recording, tool: str, *, tip_from: Path | None, plus: PlusConfiguration | None
) -> Transform:
    """``tool_from_tip``, from ``tip_from``, else ``plus``, else the case of ``recording``.

    Raises `InputError` if none of them has it.
    """
    tip = tip_frame_of(tool)
    if tip_from is not None and tip_from.suffix.lower() == ".xml":
        return read_plus_config(tip_from).transform(tool, tip)
    if tip_from is not None:
        return read_transform(tip_from, target=tool, source=tip)
    if plus is not None:
        return plus.transform(tool, tip)
    case = recording.case
    if case is not None and case.manifest.tool.frame == tool:
        return case.manifest.tool.tool_from_tip
    raise InputError(f"tip of {tool!r}: not known; expected --tip-from FILE or --plus-config FILE")


class CalibrationInputs:
    """The inputs that ``options`` of ``marginguard calibrate METHOD`` name, each read on first use.

    A method may use only the properties that belong to its declared inputs: the options for the
    others do not exist. Every property raises `InputError` for a file that cannot be used.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        """Parsed command line, for options that only one method has."""

    @property
    def span(self) -> TimeSpan:
        """The part of the recording that is used."""
        return TimeSpan(self.options.from_s, self.options.to_s)

    @cached_property
    def case(self) -> Case:
        """The recording as a case, with the clock offset that the case states."""
        return open_case(self.options.recording, package_dirs=self.options.package_dirs)

    @cached_property
    def recording(self) -> Recording:
        """The frames of the recording within `span`."""
        return open_recording(
            self.options.recording,
            self.span,
            package_dirs=self.options.package_dirs,
            rate_hz=self.options.rate_hz,
        )

    @cached_property
    def tool_track(self) -> ToolTrack:
        """The poses of the tool in the reference frame (`Input.TOOL_TRACK`)."""
        return extract_tool_track(
            self.recording,
            tool=self.options.tool or self._tool_of_plus(),
            reference=self.options.reference,
            max_age_ms=self.options.max_age_ms,
        )

    @cached_property
    def plus_configuration(self) -> PlusConfiguration | None:
        """The PLUS configuration, or None if none was given (`Input.TIP`)."""
        path = self.options.plus_config
        return None if path is None else read_plus_config(path)

    def _tool_of_plus(self) -> str | None:
        """The tool of the PLUS configuration, if one was given and its recording has the frame."""
        if getattr(self.options, "plus_config", None) is None or self.plus_configuration is None:
            return None
        tool = self.plus_configuration.tool
        tracked = {source for _, source in self.recording.edges}
        return tool if tool in tracked else None

    @cached_property
    def tool_from_tip(self) -> Transform:
        """The tip of the tool (`Input.TIP` with `Input.TOOL_TRACK`)."""
        return read_tip(
            self.recording,
            self.tool_track.tool,
            tip_from=self.options.tip_from,
            plus=self.plus_configuration,
        )
