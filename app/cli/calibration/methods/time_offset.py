"""``marginguard calibrate time``: the offset from the robot's clock to the tracker's."""

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from app.cli.calibration.argument_types import clock_offset_ms
from app.cli.calibration.calibration_method import CalibrationMethod, Input

if TYPE_CHECKING:
    from app.cli.calibration.calibration_inputs import CalibrationInputs
    from app.cli.calibration.calibration_result import CalibrationResult


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the first guess of the offset."""
    parser.add_argument(
        "--around-ms", type=clock_offset_ms, default=0.0, metavar="MS",
        help="first guess of the offset, for clocks that started at different times",
    )  # fmt: skip


def calibrate(inputs: "CalibrationInputs") -> "CalibrationResult":
    """Estimate what to add to the robot's time, from the tip's motion as both measured it.

    The offset that the case states is not used.
    """
    from app.cli.calibration.calibration_result import CalibrationResult
    from app.geometry import NS_PER_MS
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


METHOD = CalibrationMethod(
    name="time",
    summary="how much the tracker's clock reads more than the robot's",
    inputs=frozenset({Input.JOINTS}),
    run=calibrate,
    add_arguments=add_arguments,
    finds_clock_offset=True,
)
