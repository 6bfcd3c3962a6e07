"""Methods of ``marginguard calibrate`` with a tracked tool: pivot, spin, landmarks of a phantom."""

import math
from dataclasses import replace

import numpy as np

from app.cli.calibration.calibration_inputs import CalibrationInputs, tip_frame_of
from app.cli.calibration.calibration_result import CalibrationResult, Residuals
from app.files import read_landmarks
from app.geometry import FloatArray, InputError
from app.registration import (
    LandmarkDetection,
    calibrate_pivot,
    calibrate_spin,
    detect_landmarks,
    predict_tre,
    register_points,
    select_pivot_poses,
    select_poses,
    tip_transform,
)


def find_tip(inputs: CalibrationInputs) -> CalibrationResult:
    """Compute ``tool_from_tip``, with +z along the line from the sensor to the tip."""
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


def find_shaft(inputs: CalibrationInputs) -> CalibrationResult:
    """Compute ``tool_from_tip`` with +z along the shaft; the origin is that of the known tip."""
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


def find_phantom(inputs: CalibrationInputs) -> CalibrationResult:
    """Compute ``reference_from_<phantom>`` from dwells in any order."""
    track, tool_from_tip = inputs.tool_track, inputs.tool_from_tip
    landmarks_mm = _read_landmarks(inputs)
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
    notes = (*track.notes, *_match_notes(detection))
    match = detection.match
    if not match.accepted:
        return CalibrationResult("landmarks", None, False, match.reason, counts, notes=notes)
    fixed = np.array([detection.dwells[dwell].position_mm for dwell, _ in match.pairs])
    moving = np.array([landmarks_mm[name] for _, name in match.pairs])
    registration = register_points(
        fixed, moving, fixed_frame=track.reference, moving_frame=inputs.options.phantom
    )
    residuals = Residuals(
        "distance of the landmark from its dwell",
        "mm",
        "landmark",
        registration.residuals_mm,
        labels=tuple(name for _, name in detection.match.pairs),
        outliers=registration.outliers,
        leave_one_out=registration.leave_one_out_mm,
    )
    return CalibrationResult(
        kind="landmarks",
        transform=registration.transform,
        accepted=registration.accepted,
        reason=registration.reason,
        numbers={
            **counts,
            "rms_mm": residuals.rms,
            "mean_mm": float(residuals.used.mean()),
            "max_mm": residuals.largest,
            "sigma_at_centre_mm": float(predict_tre(registration, fixed.mean(axis=0)[None])[0]),
            "condition": registration.condition,
        },
        residuals=residuals,
        notes=notes,
    )


def _read_landmarks(inputs: CalibrationInputs) -> dict[str, FloatArray]:
    """Landmark positions (3,) in mm in the phantom's frame, by name."""
    if inputs.options.landmarks is not None:
        return read_landmarks(inputs.options.landmarks)
    if inputs.plus_configuration is not None:
        return dict(inputs.plus_configuration.landmarks_mm)
    raise InputError(
        "landmarks of the phantom: not given; expected --landmarks FILE or --plus-config FILE"
    )


def _match_notes(detection: LandmarkDetection) -> list[str]:
    match = detection.match
    if not match.accepted:
        return []
    notes = []
    if match.missing:
        notes.append(f"no dwell on {', '.join(match.missing)}")
    for dwell in match.unmatched_dwells:
        position = ", ".join(f"{value:.1f}" for value in detection.dwells[dwell].position_mm)
        notes.append(f"dwell {dwell + 1} at ({position}) is on no landmark")
    return notes
