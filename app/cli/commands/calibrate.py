"""Calibrate from a recording: the tip of a tool (pivot), its shaft (spin), a phantom by its
landmarks, a robot's base by its own poses (hand-eye), the lag between two clocks (time).

Exit status: 0 when the result is accepted; 1 when it was found and is not accepted: the reason is
said and nothing is saved; 2 on bad input.
"""

import argparse
import math
import time
from pathlib import Path

from app.cli.options import add_json, add_package_dirs

SUMMARY = "calibrate a tool, a phantom, a robot's base or a clock from a recording"

MOST_AGE_MS = 60_000.0
MOST_OFFSET_MS = 4e12
"""More than a century: one clock may count from 1970, and the other from its own start."""

_METHODS = {
    "pivot": "the tip of a tool that was turned about it",
    "spin": "the shaft of a tool that was turned about it",
    "landmarks": "a phantom whose landmarks a stylus dwelt on, in any order",
    "hand-eye": "the base of a robot that held a tracked sensor in many poses",
    "time": "how much the tracker's clock reads more than the robot's",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the methods of ``marginguard calibrate`` and their options."""
    methods = parser.add_subparsers(dest="method", metavar="METHOD", required=True)
    for name, summary in _METHODS.items():
        method = methods.add_parser(name, help=summary, description=f"Find {summary}.")
        # As every command has it, and a METHOD is what a user takes for one.
        method.add_argument(
            "--debug", action="store_true", default=argparse.SUPPRESS,
            help="show the traceback of an error",
        )  # fmt: skip
        _add_recording(method, with_joints=name in ("hand-eye", "time"))
        if name != "time":
            _add_frames(method)
        if name in ("spin", "landmarks"):
            method.add_argument(
                "--tip-from", type=Path, metavar="FILE",
                help="the tip in the tool's frame: YAML, .tfm, 16 numbers, PLUS configuration",
            )  # fmt: skip
            method.add_argument(
                "--plus-config", type=Path, metavar="FILE",
                help="PLUS configuration with the tip, and with the phantom's landmarks",
            )  # fmt: skip
        if name == "landmarks":
            method.add_argument(
                "--landmarks", type=Path, metavar="FILE",
                help="the phantom's landmarks: YAML or Slicer's .mrk.json",
            )  # fmt: skip
            method.add_argument(
                "--phantom", type=_frame, default="phantom", metavar="FRAME",
                help="name of the phantom's frame (%(default)s)",
            )  # fmt: skip
        if name == "time":
            method.add_argument(
                "--around-ms", type=_offset_ms, default=0.0, metavar="MS",
                help="first guess of the offset, for clocks that started at different times",
            )  # fmt: skip


def _add_recording(parser: argparse.ArgumentParser, *, with_joints: bool) -> None:
    allowed = ".igs.mha, .igs.nrrd, .mrb, .mrml, .mcap, a rosbag2 folder or a case folder"
    parser.add_argument(
        "recording", type=Path, metavar="RECORDING",
        help="a case folder, with robot.joint_states" if with_joints else allowed,
    )  # fmt: skip
    add_package_dirs(parser)
    add_json(parser)
    parser.add_argument("--save", type=Path, metavar="FILE", help="write the result, if accepted")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the residuals (.png)")
    parser.add_argument(
        "--from-s", type=_number, default=-math.inf, metavar="S",
        help="use the recording from there, in seconds from its first frame",
    )  # fmt: skip
    parser.add_argument(
        "--to-s", type=_number, default=math.inf, metavar="S", help="use it up to there"
    )


def _add_frames(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--tool",
        type=_frame,
        metavar="FRAME",
        help="the tracked frame; default: the case's, or the only one",
    )
    parser.add_argument(
        "--reference", type=_frame, metavar="FRAME",
        help="the frame to measure it in; default: 'reference', else the tool's own tracker",
    )  # fmt: skip
    parser.add_argument(
        "--max-age-ms", type=_age_ms, default=0.0, metavar="MS",
        help="how far apart in time samples of one pose may be (%(default)s)",
    )  # fmt: skip


def _number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if math.isnan(number):
        raise argparse.ArgumentTypeError(f"{text!r}: a number wanted")
    return number


def _age_ms(text: str) -> float:
    number = _number(text)
    if not 0.0 <= number <= MOST_AGE_MS:
        raise argparse.ArgumentTypeError(f"{text!r}: 0 to {MOST_AGE_MS:g} ms wanted")
    return number


def _offset_ms(text: str) -> float:
    number = _number(text)
    if not abs(number) <= MOST_OFFSET_MS:
        raise argparse.ArgumentTypeError(
            f"{text!r}: -{MOST_OFFSET_MS:g} to {MOST_OFFSET_MS:g} ms wanted"
        )
    return number


def _frame(text: str) -> str:
    if not text:
        raise argparse.ArgumentTypeError("the name of the frame is empty")
    return text


def run(options: argparse.Namespace) -> int:
    """Calibrate by the chosen method."""
    from app.cli.calibration.methods import find
    from app.cli.calibration.output import check_outputs, put_out

    check_outputs(options.save, options.plot, clock=options.method == "time")
    started_ns = time.perf_counter_ns()
    finding = find(options)
    elapsed_s = (time.perf_counter_ns() - started_ns) / 1e9
    return put_out(
        finding, elapsed_s, as_json_text=options.json, save=options.save, plot=options.plot
    )
