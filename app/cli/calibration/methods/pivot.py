"""``marginguard calibrate pivot``: the tip of a tool that was turned about its tip."""

import math
from typing import TYPE_CHECKING

from app.cli.calibration.calibration_method import CalibrationMethod, Input

if TYPE_CHECKING:
    from app.cli.calibration.calibration_inputs import CalibrationInputs
    from app.cli.calibration.calibration_result import CalibrationResult


def calibrate(inputs: "CalibrationInputs") -> "CalibrationResult":
    """Compute ``tool_from_tip``, with +z along the line from the sensor to the tip."""
    from app.cli.calibration.calibration_result import CalibrationResult, Residuals
    from app.cli.calibration.tip import tip_frame_of
    from app.registration import calibrate_pivot, select_pivot_poses

    track = inputs.tool_track
    poses = track.poses
    selected = select_pivot_poses(poses)
    pivot = calibrate_pivot([poses[index] for index in selected])
    residuals = Residuals(
        "distance of the tip from the pivot",
        "mm",
        "number of the pose",
        pivot.residuals_mm,
        outliers=pivot.outliers,
    )
    return CalibrationResult(
        kind="pivot",
        transform=pivot.tool_from_tip(tip_frame_of(track.tool)),
        accepted=pivot.accepted,
        reason=pivot.reason,
        numbers={
            "samples": len(track.samples),
            "poses": len(selected),
            "outliers": len(pivot.outliers),
            "rms_mm": residuals.rms,
            "max_mm": residuals.largest,
            "sigma_of_tip_mm": pivot.tip_sigma_mm,
            "condition": pivot.condition,
            "swing_deg": math.degrees(pivot.swing_rad),
        },
        residuals=residuals,
        notes=track.notes,
    )


METHOD = CalibrationMethod(
    name="pivot",
    summary="the tip of a tool that was turned about it",
    inputs=frozenset({Input.TOOL_TRACK}),
    run=calibrate,
)
