"""``marginguard calibrate spin``: which way the shaft points, from poses that turned about it."""

import math

import numpy as np

from app.cli.calibration.calibration_result import Finding, Residuals
from app.cli.calibration.recording import ToolTrack
from app.geometry import Transform
from app.registration import calibrate_spin, select_poses, tip_transform


def find_spin(track: ToolTrack, tool_from_tip: Transform) -> Finding:
    """The tip's frame with the shaft that was found; its origin stays where it was known to be."""
    # By angle alone: a sensor beside the shaft hardly moves when the tool is spun.
    poses = track.poses
    kept = select_poses(poses, min_distance_mm=0.0)
    tip_mm = tool_from_tip.translation_mm
    result = calibrate_spin([poses[index] for index in kept], tip_mm=tip_mm)
    residuals = Residuals(
        "angle of the shaft from its mean direction",
        "deg",
        "number of the pose",
        np.degrees(result.residuals_rad),
        outliers=result.outliers,
    )
    return Finding(
        kind="spin",
        transform=tip_transform(
            tip_mm, result.shaft, tool_frame=track.tool, tip_frame=tool_from_tip.source
        ),
        accepted=result.accepted,
        reason=result.reason,
        numbers={
            "samples": len(track.samples),
            "poses": len(kept),
            "outliers": len(result.outliers),
            "rms_deg": residuals.rms,
            "max_deg": residuals.largest,
            "sigma_of_shaft_deg": math.degrees(result.sigma_rad),
            "turn_deg": math.degrees(result.turn_rad),
        },
        residuals=residuals,
        notes=track.notes,
    )
