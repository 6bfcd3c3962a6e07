"""``marginguard calibrate landmarks``: a phantom by the landmarks that a stylus dwelt on."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from app.cli.calibration.calibration_result import Finding, Residuals
from app.cli.calibration.recording import ToolTrack
from app.geometry import FloatArray, Transform
from app.registration import LandmarkDetection, detect_landmarks, predict_tre, register_points


def find_landmarks(
    track: ToolTrack,
    tool_from_tip: Transform,
    landmarks_mm: Mapping[str, FloatArray],
    *,
    phantom: str,
) -> Finding:
    """``reference_from_<phantom>`` from dwells in any order."""
    tips = [
        replace(sample, transform=sample.transform @ tool_from_tip, source=tool_from_tip.source)
        for sample in track.samples
        if sample.transform is not None
    ]
    detection = detect_landmarks(tips, landmarks_mm)
    counts = {
        "samples": len(track.samples),
        "dwells": len(detection.dwells),
        "landmarks": len(landmarks_mm),
        "matched": len(detection.match.pairs),
    }
    notes = (*track.notes, *_notes(detection))
    if not detection.accepted:
        return Finding("landmarks", None, False, detection.reason, counts, notes=notes)
    fixed = np.array([detection.dwells[dwell].position_mm for dwell, _ in detection.match.pairs])
    moving = np.array([landmarks_mm[name] for _, name in detection.match.pairs])
    result = register_points(fixed, moving, fixed_frame=track.reference, moving_frame=phantom)
    residuals = Residuals(
        "distance of the landmark from its dwell",
        "mm",
        "landmark",
        result.residuals_mm,
        labels=tuple(name for _, name in detection.match.pairs),
        outliers=result.outliers,
        leave_one_out=result.leave_one_out_mm,
    )
    return Finding(
        kind="landmarks",
        transform=result.transform,
        accepted=result.accepted,
        reason=result.reason,
        numbers={
            **counts,
            "rms_mm": residuals.rms,
            "mean_mm": float(residuals.used.mean()),
            "max_mm": residuals.largest,
            "sigma_at_centre_mm": float(predict_tre(result, fixed.mean(axis=0)[None])[0]),
            "condition": result.condition,
        },
        residuals=residuals,
        notes=notes,
    )


def _notes(detection: LandmarkDetection) -> list[str]:
    match = detection.match
    if not match.accepted:
        return []
    notes = []
    if match.missing:
        notes.append(f"no dwell on {', '.join(match.missing)}")
    for dwell in match.unmatched_dwells:
        place = ", ".join(f"{value:.1f}" for value in detection.dwells[dwell].position_mm)
        notes.append(f"dwell {dwell + 1} at ({place}) is on no landmark")
    return notes
