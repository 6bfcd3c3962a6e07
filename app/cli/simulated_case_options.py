"""Options of commands that simulate a case: tracker, errors, patient, surgeon, duration."""

import argparse
import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from app.geometry import InputError

if TYPE_CHECKING:
    from app.synthetic import CaseOptions

TRACKERS = ("white", "aurora", "trakstar", "polaris")

_FACTORS = {"DEG": math.pi / 180.0, "MS": 1e-3}
"""From the unit of an option to that of its value, where they differ."""


class _Value(NamedTuple):
    """An option and the value of `CaseOptions` that it sets."""

    name: str
    field: str
    unit: str
    text: str


_CASE = (
    _Value("duration", "duration_s", "S", "length, 50 to 5400 s (default: about 75 s)"),
    _Value(
        "tumor-mm",
        "tumor_mm",
        "MM",
        "largest diameter of the tumour, 8 to 40 mm (default: 25 to 35 mm)",
    ),
)
_PATIENT = (
    _Value("breath-mm", "patient.breath_mm", "MM", "tumour's shift at full inspiration"),
    _Value("breath-hz", "patient.breath_hz", "HZ", "breaths per second, 0.1 to 0.5"),
    _Value(
        "elongation",
        "patient.elongation",
        "RATIO",
        "tumour's longest semi-axis over the mean of the others, 1 to 2 (default: 1.28)",
    ),
    _Value(
        "irregularity",
        "patient.irregularity",
        "FACTOR",
        "height of the tumour's lobes, 0 to 1.25 of the usual one",
    ),
    _Value("tumor-x-mm", "patient.x_mm", "MM", "place, away from the robot, -10 to 10"),
    _Value("tumor-y-mm", "patient.y_mm", "MM", "place, to the robot's left, -10 to 10"),
    _Value("tumor-z-mm", "patient.z_mm", "MM", "place, upwards, -10 to 10"),
)
_SURGEON = (
    _Value(
        "skill",
        "surgeon.skill",
        "S",
        "0 (novice) to 1 (expert): entries into the tumour, their depth, pace, evenness "
        "(default: three entries, no other effect)",
    ),
)
_TRACKER = (
    _Value("rate", "tracker.rate_hz", "HZ", "rate, 20 to 250 Hz"),
    _Value("white-mm", "tracker.white.position_rms_mm", "MM", "white jitter, RMS"),
    _Value("white-deg", "tracker.white.angle_rms_rad", "DEG", "the same of rotations"),
    _Value("slow-mm", "tracker.slow.position_rms_mm", "MM", "correlated jitter, RMS"),
    _Value("slow-deg", "tracker.slow.angle_rms_rad", "DEG", "the same of rotations"),
    _Value("correlation-s", "tracker.correlation_s", "S", "its correlation time"),
    _Value(
        "latency-ms",
        "tracker.latency_s",
        "MS",
        "stamps are this late; the calibrated offset of the clocks includes it",
    ),
    _Value("interval-ms", "tracker.period_sd_s", "MS", "spread of the sample interval"),
    _Value("stamp-ms", "tracker.stamp_sd_s", "MS", "spread of the stamps"),
    _Value("quantum-mm", "tracker.position_quantum_mm", "MM", "step of positions"),
    _Value("repeated", "tracker.repeated", "SHARE", "frames that repeat the one before"),
    _Value("skipped", "tracker.skipped", "SHARE", "frames that never arrive"),
    _Value("lost", "tracker.lost", "SHARE", "samples that are marked INVALID"),
    _Value(
        "distortion-mm",
        "tracker.distortion.shift_mm",
        "MM",
        "distortion of positions at the arm; half of it 60 mm away",
    ),
    _Value("distortion-deg", "tracker.distortion.turn_rad", "DEG", "the same of rotations"),
)
_ERRORS = (
    _Value("contour-mm", "errors.contour_mm", "MM", "error of the tumour's contour, RMS"),
    _Value("tip-mm", "errors.tip_mm", "MM", "error of the tip's calibration"),
    _Value("tip-deg", "errors.tip_rad", "DEG", "error of the tool's calibrated direction"),
    _Value("needle-mm", "errors.needle_mm", "MM", "error of the tumour's place"),
    _Value("encoder-step-deg", "errors.encoder_step_rad", "DEG", "resolution of the joints"),
    _Value(
        "encoder-offset-deg", "errors.encoder_offset_rad", "DEG", "constant error of each joint"
    ),
    _Value("clock-ms", "errors.clock_s", "MS", "error of the calibrated clock offset"),
)


def add_simulated_case(parser: argparse.ArgumentParser) -> None:
    """Add the options; `simulated_case_options` reads them."""
    _add(parser, _CASE)
    _add(parser.add_argument_group("patient"), _PATIENT)
    surgeon = parser.add_argument_group("surgeon")
    _add(surgeon, _SURGEON)
    surgeon.add_argument(
        "--fixture",
        action="store_true",
        help="an ideal virtual fixture stops the tool before it enters the tumour",
    )
    parser.add_argument(
        "--tracker",
        choices=TRACKERS,
        default=TRACKERS[0],
        help="preset: white noise at regular times and no other error (%(default)s), "
        "electromagnetic (aurora, trakstar) or optical (polaris) with typical errors of the case",
    )
    _add(parser.add_argument_group("tracker", "Each changes one value of the preset."), _TRACKER)
    _add(
        parser.add_argument_group(
            "errors of the case", "Zero with the tracker white, typical ones otherwise."
        ),
        _ERRORS,
    )


def simulated_case_options(parsed: argparse.Namespace) -> "CaseOptions":
    """The options on the command line; raises `InputError` for a value that is out of range."""
    from app.synthetic import CaseOptions

    options = CaseOptions.of_tracker(parsed.tracker, parsed.tumor_mm)
    for value in (*_CASE, *_PATIENT, *_SURGEON, *_TRACKER, *_ERRORS):
        given = getattr(parsed, value.name.replace("-", "_"))
        if given is not None:
            try:
                options = options.with_values({value.field: _FACTORS.get(value.unit, 1.0) * given})
            except InputError as error:
                raise InputError(f"--{value.name} {given:g}: {error}") from error
    return replace(options, surgeon=replace(options.surgeon, fixture=parsed.fixture))


def simulated_case_arguments(parsed: argparse.Namespace) -> list[str]:
    """The arguments that ``parsed`` was read from, without those that are defaults."""
    arguments = [] if parsed.tracker == TRACKERS[0] else ["--tracker", parsed.tracker]
    if parsed.fixture:
        arguments.append("--fixture")
    for value in (*_CASE, *_PATIENT, *_SURGEON, *_TRACKER, *_ERRORS):
        given = getattr(parsed, value.name.replace("-", "_"))
        if given is not None:
            arguments += [f"--{value.name}", repr(given).removesuffix(".0")]
    return arguments


def _add(parser: argparse._ActionsContainer, values: tuple[_Value, ...]) -> None:
    for value in values:
        parser.add_argument(f"--{value.name}", type=_number, metavar=value.unit, help=value.text)


def _number(text: str) -> float:
    from app.files.numbers import parse_numbers

    try:
        (number,) = parse_numbers(text, 1, repr(text))
    except InputError:
        number = math.nan
    if not math.isfinite(number):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number; expected a decimal number")
    return number
