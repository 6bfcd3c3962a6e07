"""Files of a report, all or none: ``summary.json``, ``margin.csv``, ``report.html``, pictures."""

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from app.analysis.samples import find_breaches
from app.case import ENERGY_DEVICE
from app.files.atomic_io import write_files
from app.fixture import MarginState
from app.report.analysis_files import analysis_document
from app.report.analysis_html import AnalysedCase, analysis_sections
from app.report.answer import Answer, answer, lowest_mm, verdict
from app.report.page import Cell, document, length, part, text_of, time_text
from app.report.record import ReplayRecord
from app.report.report_process import draw_margin_plot
from app.report.rows import ReasonCount, ReportError, count_reasons, margin_csv
from app.report.summary import ACTIVATION_AT_ENTRY, summarise
from app.report.time_plot import TimePlot, distance_plot
from app.session import SINGLE_SOURCE, structure_title

_NOTHING = Markup()
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
    rows, margins = record.rows, record.margins
    summary = summarise(record)
    structures = {each.name: each.rows for each in record.structures}
    table = margin_csv(rows, structures).encode()
    contents = {"summary.json": _json(summary), "margin.csv": table}
    sections = Markup()
    if analysed is not None:
        figures = analysed.figures()
        sections = analysis_sections(analysed, figures)
        document = analysis_document(analysed.analysis, analysed.methods)
        contents["analysis.json"] = _json(document)
        contents |= {name: figure.encode() for name, figure in figures.items()}
    distances = distance_plot(rows, find_breaches(rows, margins.stale_after_ns), margins)
    # Last, because other processes may still draw them.
    plot = margin_plot() if margin_plot else draw_margin_plot(rows, margins, record.case)
    contents["margin.png"] = plot
    scene = scene_png()
    if scene is not None:
        contents["scene.png"] = scene
    found = answer(summary, None if analysed is None else analysed.analysis)
    reasons = count_reasons(rows)
    page = report_html(summary, reasons, plot, scene, version, sections, distances, found)
    contents["report.html"] = page.encode()
    try:
        more = others()
        contents |= {name: content for name, content in more.items() if content is not None}
        write_files(folder, contents)
        for name in {*_ALL_FILES, *more} - set(contents):
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(folder, error) from error
    return summary


def _json(document: dict[str, Any]) -> bytes:
    return (json.dumps(document, indent=2, allow_nan=False) + "\n").encode()


def _unwritable(folder: Path, error: OSError) -> ReportError:
    return ReportError(f"report folder {folder} cannot be written: {error.strerror or error}")


def report_html(
    summary: dict[str, Any],
    reasons: Sequence[ReasonCount],
    margin_png: bytes,
    scene_png: bytes | None,
    version: str,
    analysis: Markup = _NOTHING,
    distances: TimePlot | None = None,
    found: Answer | None = None,
) -> str:
    """Return the page: values are escaped, pictures embedded; it has no links.

    ``analysis`` is that of `analysis_sections`, ``found`` the answer with it, by default that of
    the summary alone. ``distances`` is the plot whose static picture is
    ``margin_png``. Without both the page has no script.
    """
    picture = part("picture.html", png=margin_png, alt="Signed distance over time")
    if distances is not None:
        picture = distances.html(picture, "Signed distance over time")
    found = found or answer(summary)
    measured = "the tip alone (--tip-only)" if summary["tip_only"] else "the whole mesh of the tool"
    return document(
        "report.html",
        f"{summary['case']}: margin report",
        figures=distances is not None or bool(analysis),
        summary=summary,
        provenance="; ".join(f"{key}: {value}" for key, value in summary["provenance"].items()),
        measured=measured + (f", {SINGLE_SOURCE}" if summary["single_source"] else ""),
        answer=found,
        facts=_facts(summary),
        verdict=verdict(summary["expected"]),
        distance=picture,
        scene_png=scene_png,
        breaches=_breaches(summary["breaches"]),
        structures=_structures(summary),
        breach_header=_breach_header(summary["breaches"]),
        analysis=analysis,
        states=_states(summary),
        reasons=[(each.reason, each.frames, time_text(each.first_s)) for each in reasons],
        registration=_registration(summary["registration"]),
        version=version,
    )


def _facts(summary: dict[str, Any]) -> Sequence[tuple[str, str]]:
    frames, valid = summary["frames"], summary["valid_frames"]
    return (
        (length(lowest_mm(summary)), "smallest signed distance"),
        (time_text(summary["duration_s"]), f"replayed, {frames} frames"),
        (f"{100.0 * valid / frames:.1f} %", f"of the frames valid ({valid})"),
    )


def _breach_header(breaches: Sequence[dict[str, Any]]) -> Sequence[str]:
    has_activation = bool(breaches) and ACTIVATION_AT_ENTRY in breaches[0]
    return (
        *("breach", "from", "to", "lasted", "deepest frame"),
        *("deepest on the path", "not below", "at", "seen"),
        *((f"{ENERGY_DEVICE.name} at entry",) if has_activation else ()),
    )


def _breaches(breaches: Sequence[dict[str, Any]]) -> Sequence[Sequence[Cell]]:
    return [
        (
            number,
            time_text(breach["start_s"]),
            time_text(breach["end_s"]),
            time_text(breach["duration_s"]),
            length(breach["min_signed_distance_mm"]),
            length(breach["path_min_signed_distance_mm"]),
            length(breach["path_lower_bound_mm"]),
            "-" if breach["deepest_s"] is None else time_text(breach["deepest_s"]),
            "between frames" if breach["between_frames"] else "in frames",
            *((breach[ACTIVATION_AT_ENTRY],) if ACTIVATION_AT_ENTRY in breach else ()),
        )
        for number, breach in enumerate(breaches, start=1)
    ]


def _structures(summary: dict[str, Any]) -> Sequence[Sequence[Cell]]:
    """Rows of the further structures; empty where the tumour is the only one."""
    return [
        (
            structure_title(each["name"]),
            each["role"],
            length(lowest_mm(each)),
            len(each["breaches"]),
            time_text(each["state_seconds"]["POSITIVE"]),
            time_text(each["state_seconds"]["WARNING"]),
            f"{each['margins']['stop_mm']:g} and {each['margins']['warn_mm']:g} mm",
        )
        for each in summary.get("structures", ())
    ]


def _states(summary: dict[str, Any]) -> Sequence[Sequence[Cell]]:
    seconds, counts = summary["state_seconds"], summary["state_counts"]
    return [
        (state, MarginState[state].display.description, counts[state], time_text(seconds[state]))
        for state in counts
    ]


def _registration(registration: dict[str, Any] | None) -> Sequence[tuple[str, str]]:
    if registration is None:
        return ()
    rows = [
        (name, text_of(registration[name]))
        for name in ("method", "accepted", "reason", "points", "fre_mm", "fle_mm")
    ]
    rows.extend(
        (name, ", ".join(text_of(value) for value in registration[name]) or "-")
        for name in ("residuals_mm", "leave_one_out_mm")
    )
    matrix = registration["matrix"]
    lines = [", ".join(f"{value:.6g}" for value in matrix[at : at + 4]) for at in range(0, 16, 4)]
    rows.append((f"{registration['target']}_from_{registration['source']}", "; ".join(lines)))
    return rows
