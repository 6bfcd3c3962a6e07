"""Analyse a recorded case: breaches with their depth, distances, motion, coverage, insertion.

Replays the case and reads its steps. The depth of a breach is an estimate without the bias of the
lowest sample, with a 95 % interval.
"""

import argparse
import json
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.gc_control import GcPause
from app.cli.options import add_case, file_path, folder_path
from app.cli.progress import with_progress

if TYPE_CHECKING:
    from app.analysis import CaseAnalysis
    from app.runtime import PreparedCase

SUMMARY = "analyse a case: breaches and their depth, motion, coverage"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard analyse``."""
    add_case(parser)
    parser.add_argument(
        "--json",
        nargs="?",
        const=True,
        type=file_path(".json"),
        metavar="FILE.json",
        help="write the analysis as JSON to FILE, or print it without FILE",
    )
    parser.add_argument(
        "--csv",
        type=folder_path,
        metavar="DIR",
        help="write analysis.csv, breaches.csv and coverage.csv there",
    )
    parser.add_argument(
        "--ras-from-tumor",
        type=float,
        nargs=9,
        metavar="R",
        help="rotation from the axes of the tumour's file to right, anterior, superior, row by "
        "row; default: they are right, anterior, superior",
    )
    parser.add_argument(
        "--bias-mm",
        type=_not_negative,
        default=0.0,
        metavar="S",
        help="standard deviation of constant errors (registration, calibration, contour), which "
        "widens the intervals (default: 0)",
    )
    parser.add_argument(
        "--error",
        type=_error,
        action="append",
        default=[],
        metavar="NAME=MM",
        help="a constant error and its standard deviation along each axis, for the probability of "
        "a breach; may be repeated",
    )
    parser.add_argument(
        "--stop",
        type=_not_negative,
        action="append",
        default=[],
        metavar="MM",
        help="with --error: what an ideal fixture with this stop margin had done; may be repeated",
    )
    parser.add_argument(
        "--tip-only", action="store_true", help="check the tool's tip instead of its whole mesh"
    )


def run(options: argparse.Namespace) -> int:
    """Replay the case, analyse its steps, print and write the results."""
    import numpy as np

    from app.analysis import analyse_case
    from app.files import check_output_path, write_file
    from app.files.atomic_io import write_files
    from app.geometry import InputError
    from app.report.analysis_files import analysis_csv, analysis_document
    from app.runtime import ReplayRun, prepare_case
    from app.session import checked_axes

    axes = options.ras_from_tumor
    rows = None if axes is None else [axes[k : k + 3] for k in (0, 3, 6)]
    checked_axes(rows)
    if options.stop and not options.error:
        raise InputError("--stop: without --error; expected at least one --error NAME=MM")
    if isinstance(options.json, Path):
        check_output_path(options.json)
    with GcPause() as memory:
        prepared = prepare_case(
            options.case, package_dirs=options.package_dirs, tip_only=options.tip_only
        )
        memory.settle()
        replay = ReplayRun(prepared, clock_ns=time.monotonic_ns)
        content = prepared.content
        analysis = analyse_case(
            with_progress(replay.steps(), "analysing frame", total=None),
            name=content.name,
            margins=content.margins,
            tumor=content.tumor,
            tool=content.tool,
            ras_from_tumor=rows,
            bias_sigma_mm=options.bias_mm,
            covariances_mm2={name: sigma**2 * np.eye(3) for name, sigma in options.error},
            stops_mm=tuple(options.stop),
        )
    document = analysis_document(analysis, _methods(prepared, options))
    text = json.dumps(document, indent=2, allow_nan=False)
    if options.csv is not None:
        try:
            write_files(options.csv, analysis_csv(analysis))
        except OSError as error:
            raise InputError(f"{options.csv} cannot be written: {error.strerror}") from error
    if isinstance(options.json, Path):
        write_file(options.json, f"{text}\n".encode())
    print(text if options.json is True else as_text(analysis))
    return 0


def as_text(analysis: "CaseAnalysis") -> str:
    """Format the analysis in a few lines."""
    lines = [
        analysis.name,
        f"  frames        {analysis.frames} in {analysis.duration_s:.3f} s",
        "  jitter        "
        + (
            "not known: the case is too short"
            if analysis.jitter is None
            else f"{analysis.jitter.sigma_mm:.3f} mm along the distance"
        ),
    ]
    for number, breach in enumerate(analysis.breaches, start=1):
        found = breach.estimate
        depth = (
            f"lowest sample {breach.lowest_sample_mm:.2f} mm, no estimate"
            if found is None
            else f"{found.distance_mm:.2f} mm ({found.low_mm:.2f} to {found.high_mm:.2f}), "
            f"lowest sample {breach.lowest_sample_mm:.2f} mm"
        )
        lines.append(
            f"  breach {number:<6} {breach.start_s:.3f} to {breach.end_s:.3f} s at "
            f"{breach.direction or '-'} by the {breach.part or 'tool'}: {depth}"
        )
    if not analysis.breaches:
        lines.append("  breaches      none")
    motion, insertion = analysis.motion, analysis.insertion
    shares = analysis.coverage.shares().items()
    lines += [
        f"  path          {motion.path_mm:.1f} mm, idle {motion.idle_s:.1f} s",
        "  phases        " + ", ".join(f"{k} {v:.1f} s" for k, v in analysis.phase_seconds.items()),
        "  covered       " + ", ".join(f"{100 * v:.0f} % within {k:g} mm" for k, v in shares),
        f"  in tissue     {insertion.tissue_s:.3f} s of {insertion.elapsed_s:.3f} s, "
        f"{insertion.tissue_path_mm:.1f} mm of {insertion.path_mm:.1f} mm",
    ]
    if analysis.probability is not None:
        without = ", ".join(f"{v:.3f} without {k}" for k, v in analysis.probability.without.items())
        lines.append(f"  P(breach)     {analysis.probability.case:.3f}; {without}")
        lines += [
            f"  stop {stop.stop_mm:g} mm".ljust(16)
            + f"P(breach) {stop.probability:.3f}, holds for {stop.held_s:.2f} s"
            for stop in analysis.probability.stops
        ]
    return "\n".join(lines)


def _methods(prepared: "PreparedCase", options: argparse.Namespace) -> dict[str, Any]:
    """Version, hashes of the inputs, and the options that change a figure."""
    from app import __version__
    from app.files.paths import sha256_of

    case = prepared.case
    files = [case.folder / "case.yaml", case.recording_path]
    return {
        "version": __version__,
        "tip_only": options.tip_only,
        "bias_sigma_mm": options.bias_mm,
        "error_sigmas_mm": dict(options.error),
        "inputs_sha256": {path.name: sha256_of(path) for path in files if path is not None},
        "tumor": prepared.content.model_id,
        "depth": "Gaussian process regression with estimated jitter; docs/analysis.md",
    }


def _not_negative(text: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} mm; expected a number") from error
    if not (math.isfinite(value) and value >= 0.0):
        raise argparse.ArgumentTypeError(f"{text} mm; expected 0 or more")
    return value


def _error(text: str) -> tuple[str, float]:
    name, separator, value = text.partition("=")
    if not name or not separator:
        raise argparse.ArgumentTypeError(f"{text!r}; expected NAME=MM")
    return name, _not_negative(value)
