"""``marginguard calibrate time``: the lag between the robot's clock and the tracker's."""

from dataclasses import replace

from app.case import Case
from app.cli.calibration.calibration_result import Finding
from app.cli.calibration.recording import Span
from app.geometry import NS_PER_MS
from app.registration import estimate_time_offset
from app.session import tip_signals


def find_time_offset(case: Case, span: Span, *, around_ms: float = 0.0) -> Finding:
    """What to add to the robot's time for the tracker's, from how both saw the tip move.

    ``around_ms`` is a first guess, for clocks that started at different times. The offset that the
    case states is not used.
    """
    # Read with the guess as offset, so that joints stay beside the poses of their time.
    around_ns = round(around_ms * NS_PER_MS)
    shifted = case.with_joint_offset(around_ns)
    by_robot, by_tracker = tip_signals(case, span.of(shifted.frames()))
    by_robot = replace(by_robot, times_ns=by_robot.times_ns - around_ns)
    result = estimate_time_offset(by_robot, by_tracker, around_ns=around_ns)
    low_ns, high_ns = result.interval_ns
    return Finding(
        kind="time",
        transform=None,
        accepted=result.accepted,
        reason=result.reason,
        numbers={
            "joint_samples": len(by_robot.times_ns),
            "poses": len(by_tracker.times_ns),
            "offset_robot_to_tracker_ms": result.offset_ns / NS_PER_MS,
            "interval_low_ms": low_ns / NS_PER_MS,
            "interval_high_ms": high_ns / NS_PER_MS,
            "explained": result.explained,
        },
        notes=shifted.notes(),
    )
