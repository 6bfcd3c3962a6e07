"""Writing of the report's files: all of them or none."""

import json
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from app.analysis.breaches import find_breaches
from app.files.atomic_io import write_files
from app.report.analysis_files import analysis_document
from app.report.analysis_html import AnalysedCase, analysis_sections
from app.report.case_plots import distance_plot
from app.report.errors import ReportError
from app.report.html import report_html
from app.report.margin_csv import margin_csv
from app.report.reasons import count_reasons
from app.report.record import ReplayRecord
from app.report.report_process import draw_margin_plot
from app.report.summary import summarise

REPORT_FILES = ("summary.json", "margin.csv", "margin.png", "scene.png", "report.html")
ANALYSIS_FILES = ("analysis.json", "distances.svg", "coverage.svg")
"""Also written where the replay is analysed."""
_ALL_FILES = REPORT_FILES + ANALYSIS_FILES


def check_writable(folder: Path) -> None:
    """Raise `ReportError` if no report can be written into ``folder``; leaves no files behind.

    Call it before the replay, so that its work is not lost. The folder need not exist yet.
    """
    existing = folder
    while not existing.exists():
        if existing.is_symlink():
            raise ReportError(
                f"report folder {folder}: {existing} is a broken link; expected a folder"
            )
        existing = existing.parent
    if not existing.is_dir():
        raise ReportError(f"report folder {folder}: {existing} is a file; expected a folder")
    for name in _ALL_FILES:
        if (folder / name).is_dir():
            raise ReportError(f"report folder {folder}: {name} in it is a folder; expected a file")
    try:
        with tempfile.TemporaryFile(dir=existing):
            pass
    except OSError as error:
        raise _unwritable(folder, error) from error


def write_report(
    folder: Path,
    record: ReplayRecord,
    *,
    scene_png: Callable[[], bytes | None],
    version: str,
    analysed: AnalysedCase | None = None,
    margin_plot: Callable[[], bytes] | None = None,
    others: Callable[[], Mapping[str, bytes | None]] = dict,
) -> dict[str, Any]:
    """Write the files of `REPORT_FILES` into ``folder`` and return the summary.

    ``scene_png`` returns the picture of the deepest point. It is called last, because another
    process may still draw it. If it returns None, no ``scene.png`` is written and an earlier one is
    removed. ``analysed`` adds the sections and files of the analysis; None removes earlier files.
    ``margin_plot`` returns the PNG of `draw_margin_plot`; None draws it here. ``others`` returns
    further files by name, for which it may wait; an earlier file is removed for None.
    Earlier report files are replaced after all new ones are complete; other files in the folder are
    kept. Raises `ReportError` for a folder that cannot be written and for a replay without frames.
    """
    record.require_frames()
    check_writable(folder)
    summary, contents = _contents(record, scene_png, version, analysed, margin_plot)
    try:
        more = others()
        contents |= {name: content for name, content in more.items() if content is not None}
        write_files(folder, contents)
        for name in {*_ALL_FILES, *more} - set(contents):
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(folder, error) from error
    return summary


def _contents(
    record: ReplayRecord,
    scene_png: Callable[[], bytes | None],
    version: str,
    analysed: AnalysedCase | None,
    margin_plot: Callable[[], bytes] | None,
) -> tuple[dict[str, Any], dict[str, bytes]]:
    rows, margins = record.rows, record.margins
    summary = summarise(record)
    contents = {"summary.json": _json(summary), "margin.csv": margin_csv(rows).encode()}
    sections = Markup()
    if analysed is not None:
        figures = analysed.figures()
        sections = analysis_sections(analysed, figures)
        document = analysis_document(analysed.analysis, analysed.methods)
        contents["analysis.json"] = _json(document)
        contents |= {name: figure.encode() for name, figure in figures.items()}
    distances = distance_plot(rows, find_breaches(rows, margins.stale_after_ns), margins)
    reasons = count_reasons(rows)
    # Last, because other processes may still draw them.
    plot = margin_plot() if margin_plot else draw_margin_plot(rows, margins, record.case)
    contents["margin.png"] = plot
    scene = scene_png()
    if scene is not None:
        contents["scene.png"] = scene
    page = report_html(summary, reasons, plot, scene, version, sections, distances)
    return summary, {**contents, "report.html": page.encode()}


def _json(document: dict[str, Any]) -> bytes:
    return (json.dumps(document, indent=2, allow_nan=False) + "\n").encode()


def _unwritable(folder: Path, error: OSError) -> ReportError:
    return ReportError(f"report folder {folder} cannot be written: {error.strerror or error}")
