"""Calibrate from a recording: the tip of a tool (pivot), its shaft (spin), a phantom by its
landmarks, a robot's base by its own poses (hand-eye) or as its case specifies (robot-base), the
offset between two clocks (lag, time).

Exit status: 0 when the result is accepted; 1 when it is found but not accepted: the reason is
printed and nothing is saved; 2 on bad input.
"""

import argparse
import math
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.case import recording_kinds
from app.cli.calibration import CalibrationMethod, Input
from app.cli.options import (
    add_case,
    add_json,
    add_package_dirs,
    age_ms,
    clock_offset_ms,
    frame_name,
    input_argument,
    number,
    rate_hz,
)
from app.cli.parsing import CommandParser, add_debug

if TYPE_CHECKING:
    from app.cli.calibration.calibration_result import CalibrationResult


SUMMARY = "calibrate a tool, a phantom, a robot's base or a clock from a recording"


def _in(module: str, function: str) -> Callable[[Any], "CalibrationResult"]:
    """A function of the package of calibrations, which is loaded when it is called."""
    return lambda given: getattr(import_module(f"app.cli.calibration.{module}"), function)(given)


def _add_first_guess(parser: argparse.ArgumentParser) -> None:
    """Declare the first guess of the offset."""
    parser.add_argument(
        "--around-ms", type=clock_offset_ms, default=0.0, metavar="MS",
        help="first guess of the offset, for clocks that started at different times",
    )  # fmt: skip


def _add_phantom(parser: argparse.ArgumentParser) -> None:
    """Declare the options that describe the phantom."""
    parser.add_argument(
        "--landmarks", type=Path, metavar="FILE",
        help="the phantom's landmarks: YAML or Slicer's .mrk.json",
    )  # fmt: skip
    parser.add_argument(
        "--phantom", type=frame_name, default="phantom", metavar="FRAME",
        help="name of the phantom's frame (%(default)s)",
    )  # fmt: skip


def _add_other_signal(parser: argparse.ArgumentParser) -> None:
    """Declare the other signal and the first guess of the offset."""
    parser.add_argument(
        "--other", type=Path, metavar="FILE", required=True,
        help="the other signal: a recording, or a table (.csv) of a time in s and values",
    )  # fmt: skip
    parser.add_argument(
        "--other-tool", type=frame_name, metavar="FRAME",
        help="the tracked frame of the other recording; default: the only one",
    )  # fmt: skip
    _add_first_guess(parser)


METHODS = (
    CalibrationMethod(
        name="pivot",
        summary="the tip of a tool that was turned about it",
        inputs=frozenset({Input.TOOL_TRACK}),
        run=_in("tool_methods", "find_tip"),
    ),
    CalibrationMethod(
        name="spin",
        summary="the shaft of a tool that was turned about it",
        inputs=frozenset({Input.TOOL_TRACK, Input.TIP}),
        run=_in("tool_methods", "find_shaft"),
    ),
    CalibrationMethod(
        name="landmarks",
        summary="a phantom whose landmarks a stylus dwelt on, in any order",
        inputs=frozenset({Input.TOOL_TRACK, Input.TIP}),
        run=_in("tool_methods", "find_phantom"),
        add_arguments=_add_phantom,
    ),
    CalibrationMethod(
        name="hand-eye",
        summary="the base of a robot that held a tracked sensor in many poses",
        inputs=frozenset({Input.TOOL_TRACK, Input.JOINTS}),
        run=_in("robot_methods", "find_robot_base"),
    ),
    CalibrationMethod(
        name="lag",
        summary="how much the clock of another signal of the same motion reads more",
        inputs=frozenset({Input.TOOL_TRACK}),
        run=_in("robot_methods", "find_lag"),
        add_arguments=_add_other_signal,
        finds_clock_offset=True,
    ),
    CalibrationMethod(
        name="time",
        summary="how much the tracker's clock reads more than the robot's",
        inputs=frozenset({Input.JOINTS}),
        run=_in("robot_methods", "find_time_offset"),
        add_arguments=_add_first_guess,
        finds_clock_offset=True,
    ),
)


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
    subparser.set_defaults(find=_in("robot_methods", "robot_base_of_case"), clock_offset=False)


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
