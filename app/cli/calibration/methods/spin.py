"""``marginguard calibrate spin``: the shaft direction of a tool that was turned about its shaft."""

import math
from typing import TYPE_CHECKING

from app.cli.calibration.calibration_method import CalibrationMethod, Input

if TYPE_CHECKING:
    from app.cli.calibration.calibration_inputs import CalibrationInputs
    from app.cli.calibration.calibration_result import CalibrationResult


def calibrate(inputs: "CalibrationInputs") -> "CalibrationResult":
    """Compute ``tool_from_tip`` with +z along the shaft; the origin is that of the known tip."""
    import numpy as np

    from app.cli.calibration.calibration_result import CalibrationResult, Residuals
    from app.registration import calibrate_spin, select_poses, tip_transform

    track, tool_from_tip = inputs.tool_track, inputs.tool_from_tip
    poses = track.poses
    # By angle only: a sensor close to the shaft hardly moves during a spin.
    selected = select_poses(poses, min_distance_mm=0.0)
    tip_mm = tool_from_tip.translation_mm
    spin = calibrate_spin([poses[index] for index in selected], tip_mm=tip_mm)
    residuals = Residuals(
        "angle of the shaft from its mean direction",
        "deg",
        "number of the pose",
        np.degrees(spin.residuals_rad),
        outliers=spin.outliers,
    )
    return CalibrationResult(
        kind="spin",
        transform=tip_transform(
            tip_mm, spin.shaft, tool_frame=track.tool, tip_frame=tool_from_tip.source
        ),
        accepted=spin.accepted,
        reason=spin.reason,
        numbers={
            "samples": len(track.samples),
            "poses": len(selected),
            "outliers": len(spin.outliers),
            "rms_deg": residuals.rms,
            "max_deg": residuals.largest,
            "sigma_of_shaft_deg": math.degrees(spin.sigma_rad),
            "turn_deg": math.degrees(spin.turn_rad),
        },
        residuals=residuals,
        notes=track.notes,
    )


METHOD = CalibrationMethod(
    name="spin",
    summary="the shaft of a tool that was turned about it",
    inputs=frozenset({Input.TOOL_TRACK, Input.TIP}),
    run=calibrate,
)
