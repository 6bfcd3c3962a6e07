"""``report.pdf``: the report of a replay on A4 pages, the distance as vector graphics."""

from collections.abc import Mapping, Sequence
from typing import Any

from app.analysis import Insertion
from app.analysis.breaches import find_breaches
from app.report.colors import SOFT
from app.report.insertion_table import insertion_rows
from app.report.margin_plot import margin_figure
from app.report.page import NOT_A_DEVICE
from app.report.pdf_layout import PdfLayout
from app.report.reasons import count_reasons
from app.report.record import ReplayRecord
from app.report.summary import CAUTERY_AT_ENTRY

_BREACH_COLUMNS = ("", "from", "to", "lasted", "deepest frame", "deepest on the path", "not below")
_METHODS = (
    "The tool's mesh was checked against the tumour's surface in every frame, and on the straight "
    "path between frames around a breach. The distance is signed, negative inside. The lowest "
    "distance of a breach with jitter is too low; 'marginguard analyse' estimates the depth "
    "without that bias. The values do not contain constant errors of registration, calibration "
    "and contour."
)


def report_pdf(
    record: ReplayRecord,
    summary: Mapping[str, Any],
    scene_png: bytes | None,
    *,
    version: str,
    inputs_sha256: Mapping[str, str],
    insertion: Insertion | None = None,
) -> bytes:
    """The report as PDF. The same arguments give the same bytes.

    ``summary`` is that of ``record``; its ``timing`` is left out. ``inputs_sha256`` are the
    digests of the files of the case, by name. ``insertion``: its metrics; None leaves them out.
    """
    case = str(summary["case"])
    breaches = find_breaches(record.rows, record.margins.stale_after_ns)
    with PdfLayout(f"{case}: margin report") as pdf:
        pdf.heading(case, size=17.0)
        origin = "; ".join(f"{key}: {value}" for key, value in summary["provenance"].items())
        pdf.paragraph(origin, color=SOFT)
        pdf.paragraph(NOT_A_DEVICE)
        pdf.heading("Results")
        pdf.table(("", "value"), _results(summary), (0.5, 0.5))
        pdf.heading("Breaches")
        if summary["breaches"]:
            pdf.table(*_breaches(summary["breaches"]))
        else:
            pdf.paragraph("The tool was never in the tumour.")
        if insertion is not None:
            pdf.heading("Insertion")
            rows = insertion_rows(insertion)
            pdf.table(("metric of Perk Tutor", "value"), rows, (0.5, 0.5))
        pdf.heading("Margin states")
        seconds, counts = summary["state_seconds"], summary["state_counts"]
        states = [(name, str(counts[name]), f"{seconds[name]:.3f} s") for name in counts]
        pdf.table(("state", "frames", "time"), states, (0.4, 0.3, 0.3))
        pdf.figure(margin_figure(record.rows, breaches, record.margins, case))
        if scene_png is not None:
            pdf.heading("Deepest point")
            pdf.picture(scene_png, "Tumour, tool and robot at the smallest distance.")
        pdf.heading("Reasons")
        reasons = [
            (each.reason, str(each.frames), f"{each.first_s:.3f} s")
            for each in count_reasons(record.rows)
        ]
        pdf.table(("reason", "frames", "first at"), reasons, (0.4, 0.3, 0.3))
        pdf.heading("Margins")
        pdf.table(("parameter", "value"), _pairs(summary["margins"]), (0.5, 0.5))
        if summary["registration"] is not None:
            pdf.heading("Registration")
            pdf.table(("", "value"), _registration(summary["registration"]), (0.3, 0.7))
        if summary["expected"] is not None:
            pdf.heading("Expected results")
            checks = [
                (each["check"], each["result"], each["detail"]) for each in summary["expected"]
            ]
            pdf.table(("check", "result", "found"), checks, (0.42, 0.1, 0.48))
        if summary["notes"]:
            pdf.heading("Notes of the reader")
            for note in summary["notes"]:
                pdf.paragraph(note)
        pdf.heading("Methods")
        pdf.paragraph(_METHODS)
        digests = [("MarginGuard", version), *inputs_sha256.items()]
        pdf.table(("input", "version or SHA-256"), digests, (0.3, 0.7))
    return pdf.content


def _results(summary: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    frames, valid = summary["frames"], summary["valid_frames"]
    checks = summary["expected"]
    passed = (
        "none given"
        if checks is None
        else (f"{sum(check['result'] == 'pass' for check in checks)} of {len(checks)} pass")
    )
    return (
        ("breaches of the tumour", str(len(summary["breaches"]))),
        ("smallest signed distance in a frame", _length(summary["min_signed_distance_mm"])),
        ("smallest on the path", _length(summary["path_min_signed_distance_mm"])),
        ("replayed", f"{summary['duration_s']:.3f} s, {frames} frames"),
        ("frames with a valid distance", f"{valid} ({100.0 * valid / frames:.1f} %)"),
        ("measured", "tip alone" if summary["tip_only"] else "whole mesh of the tool"),
        ("expected results of the case", passed),
    )


def _breaches(
    breaches: Sequence[Mapping[str, Any]],
) -> tuple[tuple[str, ...], Sequence[tuple[str, ...]], tuple[float, ...]]:
    """Header, rows and widths; the cautery at entry only of a case with a source of its state."""
    rows = [
        (
            str(number),
            *(f"{breach[key]:.3f} s" for key in ("start_s", "end_s", "duration_s")),
            _length(breach["min_signed_distance_mm"]),
            _length(breach["path_min_signed_distance_mm"]),
            _length(breach["path_lower_bound_mm"]),
            *((str(breach[CAUTERY_AT_ENTRY]),) if CAUTERY_AT_ENTRY in breach else ()),
        )
        for number, breach in enumerate(breaches, start=1)
    ]
    if CAUTERY_AT_ENTRY not in breaches[0]:
        return _BREACH_COLUMNS, rows, (0.06, *(0.14,) * 4, 0.2, 0.18)
    return (*_BREACH_COLUMNS, "cautery"), rows, (0.05, *(0.12,) * 4, 0.17, 0.16, 0.14)


def _registration(registration: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    names = ("method", "accepted", "reason", "target", "source", "points", "fre_mm", "fle_mm")
    return _pairs({name: registration[name] for name in names})


def _pairs(values: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    return [(name, _text(value)) for name, value in values.items()]


def _length(value_mm: float | None) -> str:
    return "-" if value_mm is None else f"{value_mm:.2f} mm"


def _text(value: object) -> str:
    if value is None or value == "":
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
