"""Register the robot of a case as its manifest specifies, with residuals and expected error.

Exit status: 0 when the registration is accepted; 1 when it is not accepted: nothing is saved; 2 on
bad input.
"""

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.options import add_case, add_json

if TYPE_CHECKING:
    from app.cli.calibration.calibration_result import CalibrationResult
    from app.registration import RegistrationResult

SUMMARY = "register the robot of a case, with residuals"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard register``."""
    add_case(parser)
    add_json(parser)
    parser.add_argument("--save", type=Path, metavar="FILE", help="write the result, if accepted")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the residuals (.png)")


def run(options: argparse.Namespace) -> int:
    """Register the robot, print the result, save it if accepted."""
    from app.cli.calibration.output import check_outputs, write_outputs
    from app.runtime import register_case

    check_outputs(options.save, options.plot)
    started_ns = time.perf_counter_ns()
    registered = register_case(options.case, package_dirs=options.package_dirs)
    elapsed_s = (time.perf_counter_ns() - started_ns) / 1e9
    offset = registered.clock
    notes = () if offset is None else (f"clock offset estimated: {offset.reason}",)
    result = _as_calibration_result(registered.registration, (*registered.case.notes(), *notes))
    return write_outputs(
        result, elapsed_s, as_json_text=options.json, save=options.save, plot=options.plot
    )


def _as_calibration_result(
    registration: "RegistrationResult", notes: tuple[str, ...]
) -> "CalibrationResult":
    from app.cli.calibration.calibration_result import CalibrationResult, Residuals

    residuals = None
    numbers: dict[str, float] = {}
    if len(registration.residuals_mm):
        residuals = Residuals(
            "distance of the moved point from its partner",
            "mm",
            "number of the pair",
            registration.residuals_mm,
            labels=tuple(str(number) for number in range(1, len(registration.residuals_mm) + 1)),
            outliers=registration.outliers,
            leave_one_out=registration.leave_one_out_mm,
        )
        numbers = {
            "points": len(registration.residuals_mm),
            "outliers": len(registration.outliers),
            "rms_mm": residuals.rms,
            "max_mm": residuals.largest,
            "condition": registration.condition,
        }
    return CalibrationResult(
        kind=registration.method.replace("_", " "),
        transform=registration.transform,
        accepted=registration.accepted,
        reason=registration.reason,
        numbers=numbers,
        residuals=residuals,
        notes=notes,
    )
