"""``marginguard calibrate landmarks``: the pose of a phantom from dwells on its landmarks."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.calibration.argument_types import frame_name
from app.cli.calibration.calibration_method import CalibrationMethod, Input

if TYPE_CHECKING:
    from app.cli.calibration.calibration_inputs import CalibrationInputs
    from app.cli.calibration.calibration_result import CalibrationResult
    from app.geometry import FloatArray
    from app.registration import LandmarkDetection


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options that describe the phantom."""
    parser.add_argument(
        "--landmarks", type=Path, metavar="FILE",
        help="the phantom's landmarks: YAML or Slicer's .mrk.json",
    )  # fmt: skip
    parser.add_argument(
        "--phantom", type=frame_name, default="phantom", metavar="FRAME",
        help="name of the phantom's frame (%(default)s)",
    )  # fmt: skip


def calibrate(inputs: "CalibrationInputs") -> "CalibrationResult":
    """Compute ``reference_from_<phantom>`` from dwells in any order."""
    import numpy as np

    from app.cli.calibration.calibration_result import CalibrationResult, Residuals
    from app.registration import detect_landmarks, predict_tre, register_points

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
    if not detection.accepted:
        return CalibrationResult("landmarks", None, False, detection.reason, counts, notes=notes)
    fixed = np.array([detection.dwells[dwell].position_mm for dwell, _ in detection.match.pairs])
    moving = np.array([landmarks_mm[name] for _, name in detection.match.pairs])
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


def _read_landmarks(inputs: "CalibrationInputs") -> "dict[str, FloatArray]":
    """Landmark positions (3,) in mm in the phantom's frame, by name."""
    from app.files import read_landmarks
    from app.geometry import InputError

    if inputs.options.landmarks is not None:
        return read_landmarks(inputs.options.landmarks)
    if inputs.plus_configuration is not None:
        return dict(inputs.plus_configuration.landmarks_mm)
    raise InputError(
        "landmarks of the phantom: not given; expected --landmarks FILE or --plus-config FILE"
    )


def _match_notes(detection: "LandmarkDetection") -> list[str]:
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


METHOD = CalibrationMethod(
    name="landmarks",
    summary="a phantom whose landmarks a stylus dwelt on, in any order",
    inputs=frozenset({Input.TOOL_TRACK, Input.TIP}),
    run=calibrate,
    add_arguments=add_arguments,
)
