"""Writes the report's files: all of them or none."""

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from app.files.atomic_io import write_files
from app.report.breaches import find_breaches
from app.report.errors import ReportError
from app.report.html import report_html
from app.report.margin_csv import margin_csv
from app.report.reasons import count_reasons
from app.report.record import ReplayRecord
from app.report.summary import summarise

REPORT_FILES = ("summary.json", "margin.csv", "margin.png", "scene.png", "report.html")


def check_writable(folder: Path) -> None:
    """Raise `ReportError` when no report can be written into ``folder``; leaves nothing behind.

    Ask before the replay, so that its work is not lost. The folder need not exist yet.
    """
    existing = folder
    while not existing.exists():
        if existing.is_symlink():
            raise ReportError(f"report folder {folder}: {existing} is a link that leads nowhere")
        existing = existing.parent
    if not existing.is_dir():
        raise ReportError(f"report folder {folder}: {existing} is a file, a folder wanted")
    for name in REPORT_FILES:
        if (folder / name).is_dir():
            raise ReportError(f"report folder {folder}: {name} in it is a folder, a file wanted")
    try:
        with tempfile.TemporaryFile(dir=existing):
            pass
    except OSError as error:
        raise _unwritable(folder, error) from error


def write_report(
    folder: Path, record: ReplayRecord, *, scene_png: Callable[[], bytes | None], version: str
) -> dict[str, Any]:
    """Write the files of `REPORT_FILES` into ``folder`` and return the summary.

    ``scene_png`` gives the picture of the deepest moment, and is asked when all else is ready, as
    it may still be drawn; None where it cannot be: then there is no ``scene.png``, and one of an
    earlier replay is removed. Earlier report files are replaced once every new one is whole; other
    files in the folder are left alone. A folder that cannot be written and a replay without frames
    raise `ReportError`.
    """
    if not record.rows:
        raise ReportError(f"case {record.case!r} gave no frame: at least 1 wanted for a report")
    check_writable(folder)
    summary, contents = _contents(record, scene_png, version)
    try:
        write_files(folder, contents)
        for name in set(REPORT_FILES) - set(contents):
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(folder, error) from error
    return summary


def _contents(
    record: ReplayRecord, scene_png: Callable[[], bytes | None], version: str
) -> tuple[dict[str, Any], dict[str, bytes]]:
    # Matplotlib takes its time to load: now, while scene.png may still be drawn elsewhere.
    from app.report.margin_plot import margin_png

    summary = summarise(record)
    breaches = find_breaches(record.rows, record.margins.stale_after_ns)
    plot = margin_png(record.rows, breaches, record.margins, record.case)
    contents = {
        "summary.json": (json.dumps(summary, indent=2, allow_nan=False) + "\n").encode(),
        "margin.csv": margin_csv(record.rows).encode(),
        "margin.png": plot,
    }
    scene = scene_png()
    if scene is not None:
        contents["scene.png"] = scene
    page = report_html(summary, count_reasons(record.rows), plot, scene, version)
    return summary, {**contents, "report.html": page.encode()}


def _unwritable(folder: Path, error: OSError) -> ReportError:
    return ReportError(f"report folder {folder} cannot be written: {error.strerror or error}")
