"""Calibrate from a recording: the tip of a tool (pivot), its shaft (spin), a phantom by its
landmarks, a robot's base by its own poses (hand-eye), the lag between two clocks (time).

Exit status: 0 when the result is accepted; 1 when it is found but not accepted: the reason is
printed and nothing is saved; 2 on bad input.
"""

import argparse
import math
import time
from pathlib import Path

from app.cli.calibration.argument_types import age_ms, frame_name, number, rate_hz
from app.cli.calibration.calibration_method import CalibrationMethod, Input
from app.cli.calibration.registry import load_methods
from app.cli.options import add_json, add_package_dirs, input_argument

SUMMARY = "calibrate a tool, a phantom, a robot's base or a clock from a recording"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the methods of ``marginguard calibrate`` and their options."""
    subparsers = parser.add_subparsers(dest="method", metavar="METHOD", required=True)
    for method in load_methods().values():
        subparser = subparsers.add_parser(
            method.name, help=method.summary, description=f"Find {method.summary}."
        )
        # Every command has --debug; it is accepted behind METHOD, too.
        subparser.add_argument(
            "--debug", action="store_true", default=argparse.SUPPRESS,
            help="show the traceback of an error",
        )  # fmt: skip
        _add_recording(subparser, with_joints=Input.JOINTS in method.inputs)
        if Input.TOOL_TRACK in method.inputs:
            _add_tool_track(subparser)
        if Input.TIP in method.inputs:
            _add_tip(subparser)
        method.add_arguments(subparser)
        subparser.set_defaults(calibration_method=method)


def _add_recording(parser: argparse.ArgumentParser, *, with_joints: bool) -> None:
    from app.case import recording_kinds

    allowed = f"{recording_kinds()} or a case folder"
    parser.add_argument(
        "recording", type=input_argument, metavar="RECORDING",
        help="a case folder, with robot.joint_states" if with_joints else allowed,
    )  # fmt: skip
    add_package_dirs(parser)
    add_json(parser)
    parser.add_argument("--save", type=Path, metavar="FILE", help="write the result, if accepted")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the residuals (.png)")
    parser.add_argument(
        "--from-s", type=number, default=-math.inf, metavar="S",
        help="use the recording from there, in seconds from its first frame",
    )  # fmt: skip
    parser.add_argument(
        "--to-s", type=number, default=math.inf, metavar="S", help="use it up to there"
    )
    parser.add_argument(
        "--rate-hz", type=rate_hz, metavar="HZ", help="rate of a recording without times"
    )


def _add_tool_track(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--tool",
        type=frame_name,
        metavar="FRAME",
        help="the tracked frame; default: the case's, or the only one",
    )
    parser.add_argument(
        "--reference", type=frame_name, metavar="FRAME",
        help="the frame to measure it in; default: 'reference', else the tool's own tracker",
    )  # fmt: skip
    parser.add_argument(
        "--max-age-ms", type=age_ms, default=0.0, metavar="MS",
        help="how far apart in time samples of one pose may be (%(default)s)",
    )  # fmt: skip


def _add_tip(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--tip-from", type=Path, metavar="FILE",
        help="the tip in the tool's frame: YAML, .tfm, .h5, 16 numbers, PLUS configuration",
    )  # fmt: skip
    parser.add_argument(
        "--plus-config", type=Path, metavar="FILE",
        help="PLUS configuration with the tip, and with the phantom's landmarks",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Calibrate by the chosen method."""
    from app.cli.calibration.calibration_inputs import CalibrationInputs
    from app.cli.calibration.output import check_outputs, write_outputs

    method: CalibrationMethod = options.calibration_method
    check_outputs(options.save, options.plot, clock_offset=method.finds_clock_offset)
    started_ns = time.perf_counter_ns()
    result = method.run(CalibrationInputs(options))
    elapsed_s = (time.perf_counter_ns() - started_ns) / 1e9
    return write_outputs(
        result, elapsed_s, as_json_text=options.json, save=options.save, plot=options.plot
    )
