"""From the options of ``marginguard calibrate`` to what the chosen method finds."""

import argparse

from app.case import open_case
from app.cli.calibration.calibration_result import Finding
from app.cli.calibration.clocks import find_time_offset
from app.cli.calibration.hand_eye import find_hand_eye
from app.cli.calibration.landmarks import find_landmarks
from app.cli.calibration.pivot import find_pivot
from app.cli.calibration.recording import Span, follow_tool, open_recording
from app.cli.calibration.spin import find_spin
from app.cli.calibration.tip import known_tip
from app.files import PlusConfiguration, read_landmarks, read_plus_config
from app.geometry import FloatArray, InputError


def find(options: argparse.Namespace) -> Finding:
    """Read what the method needs, and run it."""
    span = Span(options.from_s, options.to_s)
    if options.method == "time":
        case = open_case(options.recording, package_dirs=options.package_dirs)
        return find_time_offset(case, span, around_ms=options.around_ms)
    recording = open_recording(options.recording, span, package_dirs=options.package_dirs)
    track = follow_tool(
        recording,
        tool=options.tool,
        reference=options.reference,
        max_age_ms=options.max_age_ms,
    )
    if options.method == "pivot":
        return find_pivot(track)
    if options.method == "hand-eye":
        return find_hand_eye(recording, track)
    plus = None if options.plus_config is None else read_plus_config(options.plus_config)
    tool_from_tip = known_tip(recording, track.tool, tip_from=options.tip_from, plus=plus)
    if options.method == "spin":
        return find_spin(track, tool_from_tip)
    landmarks = _landmarks(options, plus)
    return find_landmarks(track, tool_from_tip, landmarks, phantom=options.phantom)


def _landmarks(
    options: argparse.Namespace, plus: PlusConfiguration | None
) -> dict[str, FloatArray]:
    if options.landmarks is not None:
        return read_landmarks(options.landmarks)
    if plus is not None:
        return dict(plus.landmarks_mm)
    raise InputError("the landmarks are not known: --landmarks FILE or --plus-config FILE wanted")
