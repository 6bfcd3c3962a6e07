"""``marginguard calibrate lag``: the offset between the clocks of two signals of one motion."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.calibration.argument_types import clock_offset_ms, frame_name
from app.cli.calibration.calibration_method import CalibrationMethod, Input

if TYPE_CHECKING:
    from app.cli.calibration.calibration_inputs import CalibrationInputs
    from app.cli.calibration.calibration_result import CalibrationResult
    from app.registration import TimedSignal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the other signal and the first guess of the offset."""
    parser.add_argument(
        "--other", type=Path, metavar="FILE", required=True,
        help="the other signal: a recording, or a table (.csv) of a time in s and values",
    )  # fmt: skip
    parser.add_argument(
        "--other-tool", type=frame_name, metavar="FRAME",
        help="the tracked frame of the other recording; default: the only one",
    )  # fmt: skip
    parser.add_argument(
        "--around-ms", type=clock_offset_ms, default=0.0, metavar="MS",
        help="first guess of the offset, for clocks that started at different times",
    )  # fmt: skip


def calibrate(inputs: "CalibrationInputs") -> "CalibrationResult":
    """Estimate how much more the clock of the other signal reads than the recording's.

    One signal is fitted as a linear function of the one with more values. So positions by a tracker
    explain the position of a line in a video, whatever the pose of the camera and its scale.
    """
    from app.cli.calibration.calibration_result import CalibrationResult
    from app.geometry import NS_PER_MS
    from app.registration import TimedSignal, estimate_time_offset

    track = inputs.tool_track
    first = TimedSignal.from_positions(track.samples)
    second, notes = _other(inputs)
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


def _other(inputs: "CalibrationInputs") -> "tuple[TimedSignal, tuple[str, ...]]":
    import numpy as np

    from app.cli.calibration.recording import TimeSpan, extract_tool_track, open_recording
    from app.files.signal_file import SIGNAL_ENDING, read_signal
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


METHOD = CalibrationMethod(
    name="lag",
    summary="how much the clock of another signal of the same motion reads more",
    inputs=frozenset({Input.TOOL_TRACK}),
    run=calibrate,
    add_arguments=add_arguments,
    finds_clock_offset=True,
)
