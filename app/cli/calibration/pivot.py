"""``marginguard calibrate pivot``: the tip of a tool from its poses while it turned about it."""

import math

from app.cli.calibration.calibration_result import Finding, Residuals
from app.cli.calibration.recording import ToolTrack
from app.cli.calibration.tip import tip_frame_of
from app.registration import calibrate_pivot, select_poses


def find_pivot(track: ToolTrack) -> Finding:
    """The tip's frame in the tool's, +z along the shaft, which is taken from sensor to tip."""
    poses = track.poses
    kept = select_poses(poses)
    result = calibrate_pivot([poses[index] for index in kept])
    residuals = Residuals(
        "distance of the tip from the pivot",
        "mm",
        "number of the pose",
        result.residuals_mm,
        outliers=result.outliers,
    )
    return Finding(
        kind="pivot",
        transform=result.tool_from_tip(tip_frame_of(track.tool)),
        accepted=result.accepted,
        reason=result.reason,
        numbers={
            "samples": len(track.samples),
            "poses": len(kept),
            "outliers": len(result.outliers),
            "rms_mm": residuals.rms,
            "max_mm": residuals.largest,
            "sigma_of_tip_mm": result.tip_sigma_mm,
            "condition": result.condition,
            "swing_deg": math.degrees(result.swing_rad),
        },
        residuals=residuals,
        notes=track.notes,
    )
