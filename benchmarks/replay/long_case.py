"""A recorded case repeated to the length of an operation, as a case of its own."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from app.case import TrackingFrame, open_case, write_recording
from app.geometry import NS_PER_S, InputError, Stamp

_RECORDING = "repeated.mcap"


def write_long_case(folder: Path, case_folder: Path, duration_s: float) -> None:
    """Write a case to the new ``folder`` whose recording is repeated up to ``duration_s``.

    Drops the expected results, which are those of one round. Raises `InputError` for a case whose
    joint clock must be estimated, and for one whose last frame is not the latest.
    """
    case = open_case(case_folder)
    clock, robot = case.manifest.clock, case.manifest.robot
    frames = list(case.recorded_frames())
    if len(frames) < 2 or not max(frames[0].stamp, frames[-2].stamp) < frames[-1].stamp:
        raise InputError(
            f"{case_folder} has {len(frames)} frames; expected 2 or more, the last one the latest"
        )
    shutil.copytree(case_folder, folder)
    topic = {"joint_states_topic": robot.joint_states} if robot and robot.joint_states else {}
    write_recording(
        folder / _RECORDING,
        _repeated(frames, round(duration_s * NS_PER_S)),
        robot_to_tracker_offset_ns=clock.offset_robot_to_tracker_ns,
        **topic,
    )
    manifest: dict[str, Any] = yaml.safe_load((folder / "case.yaml").read_text(encoding="utf-8"))
    manifest.pop("expected", None)
    manifest["recording"] = {"path": _RECORDING}
    (folder / "case.yaml").write_text(yaml.safe_dump(manifest), encoding="utf-8")


def _repeated(frames: list[TrackingFrame], duration_ns: int) -> Iterator[TrackingFrame]:
    first_ns, last_ns = frames[0].stamp.ns, frames[-1].stamp.ns
    # The gap between two rounds is the last period of the recording.
    round_ns = last_ns - first_ns + last_ns - frames[-2].stamp.ns
    shift_ns = 0
    while True:
        for frame in frames:
            if frame.stamp.ns + shift_ns - first_ns > duration_ns:
                return
            yield _shifted(frame, shift_ns)
        shift_ns += round_ns


def _shifted(frame: TrackingFrame, shift_ns: int) -> TrackingFrame:
    def shifted(stamp: Stamp | None) -> Stamp | None:
        return stamp and stamp.shifted(shift_ns, stamp.clock)

    return replace(
        frame,
        stamp=shifted(frame.stamp),
        poses=tuple(replace(pose, stamp=shifted(pose.stamp)) for pose in frame.poses),
        joints=tuple(replace(each, stamp=shifted(each.stamp)) for each in frame.joints),
        unfiltered_stamp=shifted(frame.unfiltered_stamp),
    )
