"""Analyse a recorded case: breaches with their depth, distances, motion, coverage, insertion.

Replays the case and reads its steps. The depth of a breach is an estimate without the bias of the
lowest sample, with a 95 % interval.
"""

import argparse
import json
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING

from app import __version__
from app.cli.dicom_folder import VOXEL_MM, resected_structures, write_dicom
from app.cli.options import add_case, add_tip_only, add_tool, file_path, folder_path, quantity
from app.cli.process import GcPause
from app.cli.progress import with_progress
from app.files import check_output_path, write_file
from app.files.atomic_io import write_files, writing
from app.files.extras import check_installed
from app.geometry import NS_PER_S, InputError

if TYPE_CHECKING:
    from app.analysis import CaseAnalysis
    from app.analysis.breach_probability import Outcome
    from app.analysis.specimen import Resection

_not_negative = quantity("mm", "0 or more", lambda mm: 0.0 <= mm < math.inf)
_length = quantity("mm", "more than 0", lambda mm: 0.0 < mm < math.inf)

SUMMARY = "analyse a case: breaches and their depth, motion, coverage"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard analyse``."""
    add_case(parser)
    add_tool(parser)
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
        help="write the tables there: analysis, breaches, coverage, directions; with --error also "
        "moments (probability of a breach at each frame) and whatif (by source and stop margin)",
    )
    parser.add_argument(
        "--html",
        type=file_path(".html"),
        metavar="FILE.html",
        help="write the analysis as one page, with figures and without external resources",
    )
    parser.add_argument(
        "--parquet",
        type=file_path(".parquet"),
        metavar="FILE.parquet",
        help="write a row per frame: state, hold, applied margins, distance, witness points, "
        "velocity of the tip (needs the extra cohort)",
    )
    parser.add_argument(
        "--dicom",
        type=folder_path,
        metavar="DIR",
        help="write the tumour and the specimen, where one is separated, to the new folder DIR as "
        "DICOM segmentation and structure set",
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
        "--cutting-mm",
        type=_length,
        default=10.0,
        metavar="MM",
        help="length of the tool's cutting part from its tip, for the swept volume and the "
        "resected specimen (default: 10)",
    )
    add_tip_only(parser)


def run(options: argparse.Namespace) -> int:
    """Replay the case, analyse its steps, print and write the results."""
    from app.analysis import CaseSamples
    from app.report import analysed_case, analysis_page
    from app.report.analysis_files import FramesTable, analysis_csv, analysis_document
    from app.runtime import ReplayRun, prepare_case
    from app.session import checked_axes

    axes = options.ras_from_tumor
    rows = None if axes is None else [axes[k : k + 3] for k in (0, 3, 6)]
    checked_axes(rows)
    if options.stop and not options.error:
        raise InputError("--stop: without --error; expected at least one --error NAME=MM")
    if options.parquet is not None:
        check_installed("pyarrow")
    if options.dicom is not None:
        check_installed("highdicom", "pydicom")
    for path in (options.json, options.html, options.parquet):
        if isinstance(path, Path):
            check_output_path(path)
    with GcPause() as memory:
        prepared = prepare_case(
            options.case,
            package_dirs=options.package_dirs,
            tip_only=options.tip_only,
            tool=options.tool,
        )
        memory.settle()
        content = prepared.content
        frames = FramesTable(content.margins.stale_after_ns / NS_PER_S)
        outputs = () if options.parquet is None else (frames,)
        replay = ReplayRun(prepared, clock_ns=time.monotonic_ns, outputs=outputs)
        steps = with_progress(replay.steps(), "analysing frame", total=None)
        samples = CaseSamples.from_steps(steps)
        case = analysed_case(
            prepared,
            samples,
            __version__,
            cutting_mm=options.cutting_mm,
            ras_from_tumor=rows,
            bias_sigma_mm=options.bias_mm,
            error_sigmas_mm=dict(options.error),
            stops_mm=tuple(options.stop),
        )
    analysis = case.analysis
    document = analysis_document(analysis, case.methods)
    text = json.dumps(document, indent=2, allow_nan=False)
    if options.csv is not None:
        with writing(options.csv):
            write_files(options.csv, analysis_csv(analysis))
    if options.html is not None:
        write_file(options.html, analysis_page(case, case.figures()).encode())
    if options.parquet is not None:
        write_file(options.parquet, frames.parquet())
    if options.dicom is not None:
        write_dicom(
            options.dicom,
            resected_structures(content.tumor, analysis),
            ras_from_tumor=rows,
            patient=content.name,
            voxel_mm=VOXEL_MM,
        )
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
        f"{insertion.tissue_path_mm:.1f} mm of {insertion.path_mm:.1f} mm"
        + (
            ""
            if insertion.tissue_damage_mm2 is None
            else f", {insertion.tissue_damage_mm2:.0f} mm2 swept by its axis"
        ),
    ]
    if analysis.resection is not None:
        lines += _resection(analysis.resection)
    if analysis.probability is not None:
        risk = analysis.probability
        lines.append(f"  P(breach)     {_outcome(risk.outcome)}")
        lines += [
            f"  no {name} error".ljust(15)
            + f" {_outcome(effect.without)}; {100.0 * effect.variance_share:.0f} % of the variance"
            for name, effect in risk.sources.items()
        ]
        lines += [
            f"  stop {stop.stop_mm:g} mm".ljust(16)
            + f"{_outcome(stop.outcome)}; holds for {stop.held_s:.2f} s"
            for stop in risk.stops
        ]
    return "\n".join(lines)


def _resection(found: "Resection") -> list[str]:
    from app.geometry import ANATOMICAL_WORDS

    lines = []
    if found.swept is not None:
        lines.append(
            f"  swept         {found.swept.volume_mm3:.0f} mm3 by the last {found.cutting_mm:g} mm "
            f"of the tool, {found.tumor_cut_mm3:.1f} mm3 of it tumour"
        )
    specimen = found.specimen
    if specimen is None:
        return [*lines, f"  specimen      none: {found.why}"]
    closest = specimen.closest
    return [
        *lines,
        f"  specimen      {specimen.volume_mm3:.0f} mm3, closest margin "
        f"{specimen.margins_mm[closest]:.2f} mm {ANATOMICAL_WORDS[closest]}",
    ]


def _outcome(outcome: "Outcome") -> str:
    low, middle, high = outcome.lowest_mm
    return (
        f"{outcome.probability:.3f}, inside for {outcome.inside_s:.2f} s, "
        f"lowest {middle:.2f} mm ({low:.2f} to {high:.2f})"
    )


def _error(text: str) -> tuple[str, float]:
    name, separator, value = text.partition("=")
    if not name or not separator:
        raise argparse.ArgumentTypeError(f"{text!r}; expected NAME=MM")
    return name, _not_negative(value)
