"""Calibrate from a recording: the tip of a tool (pivot), its shaft (spin), a phantom by its
landmarks, a robot's base by its own poses (hand-eye) or as its case specifies (robot-base), the
offset between two clocks (lag, time).

Exit status: 0 when the result is accepted; 1 when it is found but not accepted: the reason is
printed and nothing is saved; 2 on bad input.
"""

import argparse
import math
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from app.case import recording_kinds
from app.cli.calibration import CalibrationMethod, Input, robot_methods, tool_methods
from app.cli.options import (
    add_case,
    add_json,
    add_package_dirs,
    age_ms,
    frame_name,
    input_argument,
    number,
    rate_hz,
)
from app.cli.parsing import CommandParser, add_debug

if TYPE_CHECKING:
    from app.cli.calibration.calibration_result import CalibrationResult


SUMMARY = "calibrate a tool, a phantom, a robot's base or a clock from a recording"
METHODS = (*tool_methods.METHODS, *robot_methods.METHODS)


def add_arguments(parser: CommandParser) -> None:
    """Declare the methods of ``marginguard calibrate`` and their options."""
    subparsers = parser.add_subparsers(dest="method", metavar="METHOD", required=True)
    for method in sorted(METHODS, key=lambda method: method.name):
        subparser = subparsers.add_parser(
            method.name, help=method.summary, description=f"Find {method.summary}."
        )
        add_debug(subparser)
        _add_recording(subparser, with_joints=Input.JOINTS in method.inputs)
        if Input.TOOL_TRACK in method.inputs:
            _add_tool_track(subparser)
        if Input.TIP in method.inputs:
            _add_tip(subparser)
        method.add_arguments(subparser)
        subparser.set_defaults(
            find=partial(_by_method, method), clock_offset=method.finds_clock_offset
        )
    subparser = subparsers.add_parser(
        "robot-base",
        help="the base of a case's robot, as its registration specifies",
        description="Register the robot of a case as its manifest specifies, with residuals and "
        "expected error.",
    )
    add_debug(subparser)
    add_case(subparser)
    _add_outputs(subparser)
    subparser.set_defaults(find=robot_methods.robot_base_of_case, clock_offset=False)


def _add_recording(parser: argparse.ArgumentParser, *, with_joints: bool) -> None:
    allowed = f"{recording_kinds()} or a case folder"
    parser.add_argument(
        "recording", type=input_argument, metavar="RECORDING",
        help="a case folder, with robot.joint_states" if with_joints else allowed,
    )  # fmt: skip
    add_package_dirs(parser)
    _add_outputs(parser)
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


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    add_json(parser)
    parser.add_argument("--save", type=Path, metavar="FILE", help="write the result, if accepted")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the residuals (.png)")


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
    from app.cli.calibration.calibration_result import check_outputs, write_outputs

    check_outputs(options.save, options.plot, clock_offset=options.clock_offset)
    started_ns = time.perf_counter_ns()
    result = options.find(options)
    elapsed_s = (time.perf_counter_ns() - started_ns) / 1e9
    return write_outputs(
        result, elapsed_s, as_json_text=options.json, save=options.save, plot=options.plot
    )


def _by_method(method: CalibrationMethod, options: argparse.Namespace) -> "CalibrationResult":
    from app.cli.calibration.calibration_inputs import CalibrationInputs

    return method.run(CalibrationInputs(options))
