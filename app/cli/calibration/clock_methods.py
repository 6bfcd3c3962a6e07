"""Methods of ``marginguard calibrate`` for the offset between two clocks: lag and time."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.calibration import CalibrationMethod, Input
from app.cli.options import clock_offset_ms, frame_name
from app.geometry import NS_PER_MS

if TYPE_CHECKING:
    from app.cli.calibration.calibration_inputs import CalibrationInputs
    from app.cli.calibration.calibration_result import CalibrationResult
    from app.registration import TimedSignal


def _add_other_signal(parser: argparse.ArgumentParser) -> None:
    """Declare the other signal and the first guess of the offset."""
    parser.add_argument(
        "--other", type=Path, metavar="FILE", required=True,
        help="the other signal: a recording, or a table (.csv) of a time in s and values",
    )  # fmt: skip
    parser.add_argument(
        "--other-tool", type=frame_name, metavar="FRAME",
        help="the tracked frame of the other recording; default: the only one",
    )  # fmt: skip
    _add_first_guess(parser)


def find_lag(inputs: "CalibrationInputs") -> "CalibrationResult":
    """Estimate how much more the clock of the other signal reads than the recording's.

    One signal is fitted as a linear function of the one with more values. So positions by a tracker
    explain the position of a line in a video, whatever the pose of the camera and its scale.
    """
    from app.cli.calibration.calibration_result import CalibrationResult
    from app.registration import TimedSignal, estimate_time_offset

    track = inputs.tool_track
    first = TimedSignal.from_positions(track.samples)
    second, notes = _other_signal(inputs)
    around_ns = round(inputs.options.around_ms * NS_PER_MS)
    is_swapped = first.values.shape[1] < second.values.shape[1]
    a, b, sign = (second, first, -1) if is_swapped else (first, second, 1)
    offset = estimate_time_offset(a, b, around_ns=sign * around_ns)
    low_ns, high_ns = sorted(sign * each for each in offset.interval_ns)
    return CalibrationResult(
        kind="lag",
        transform=None,
        accepted=offset.accepted,
        reason=offset.reason if sign > 0 else f"{offset.reason} (from the other to this signal)",
        numbers={
            "samples": len(first.times_ns),
            "other_samples": len(second.times_ns),
            "offset_ms": sign * offset.offset_ns / NS_PER_MS,
            "interval_low_ms": low_ns / NS_PER_MS,
            "interval_high_ms": high_ns / NS_PER_MS,
            "explained": offset.explained,
        },
        notes=(*track.notes, *notes),
    )


def _other_signal(inputs: "CalibrationInputs") -> "tuple[TimedSignal, tuple[str, ...]]":
    import numpy as np

    from app.cli.calibration.calibration_inputs import TimeSpan, extract_tool_track, open_recording
    from app.files.numbers import SIGNAL_ENDING, read_signal
    from app.registration import TimedSignal

    path: Path = inputs.options.other
    if path.suffix.lower() == SIGNAL_ENDING:
        times, values = read_signal(path)
        return TimedSignal(np.array(times, dtype=np.int64), values, path.name), ()
    other = open_recording(path, TimeSpan(), package_dirs=inputs.options.package_dirs)
    track = extract_tool_track(
        other,
        tool=inputs.options.other_tool,
        reference=None,
        max_age_ms=inputs.options.max_age_ms,
    )
    return TimedSignal.from_positions(track.samples), track.notes


def _add_first_guess(parser: argparse.ArgumentParser) -> None:
    """Declare the first guess of the offset."""
    parser.add_argument(
        "--around-ms", type=clock_offset_ms, default=0.0, metavar="MS",
        help="first guess of the offset, for clocks that started at different times",
    )  # fmt: skip


def find_time_offset(inputs: "CalibrationInputs") -> "CalibrationResult":
    """Estimate what to add to the robot's time, from the tip's motion as both measured it.

    The offset that the case states is not used.
    """
    from app.cli.calibration.calibration_result import CalibrationResult
    from app.registration import estimate_time_offset
    from app.session import tip_signals

    # Apply the guess while reading, so that frames pair joints with poses of the same time.
    around_ns = round(inputs.options.around_ms * NS_PER_MS)
    shifted = inputs.case.with_joint_offset(around_ns)
    by_robot, by_tracker = tip_signals(inputs.case, inputs.span.select(shifted.frames()))
    by_robot = replace(by_robot, times_ns=by_robot.times_ns - around_ns)
    offset = estimate_time_offset(by_robot, by_tracker, around_ns=around_ns)
    low_ns, high_ns = offset.interval_ns
    return CalibrationResult(
        kind="time",
        transform=None,
        accepted=offset.accepted,
        reason=offset.reason,
        numbers={
            "joint_samples": len(by_robot.times_ns),
            "poses": len(by_tracker.times_ns),
            "offset_robot_to_tracker_ms": offset.offset_ns / NS_PER_MS,
            "interval_low_ms": low_ns / NS_PER_MS,
            "interval_high_ms": high_ns / NS_PER_MS,
            "explained": offset.explained,
        },
        notes=shifted.notes(),
    )


METHODS = (
    CalibrationMethod(
        name="lag",
        summary="how much the clock of another signal of the same motion reads more",
        inputs=frozenset({Input.TOOL_TRACK}),
        run=find_lag,
        add_arguments=_add_other_signal,
        finds_clock_offset=True,
    ),
    CalibrationMethod(
        name="time",
        summary="how much the tracker's clock reads more than the robot's",
        inputs=frozenset({Input.JOINTS}),
        run=find_time_offset,
        add_arguments=_add_first_guess,
        finds_clock_offset=True,
    ),
)
