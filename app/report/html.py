"""``report.html``: the report as one file without external resources."""

import base64
from collections.abc import Sequence
from html import escape
from typing import Any

from app.fixture import MarginState
from app.report.page import NOT_A_DEVICE, document, length, scrolling, table, text_of, time_text
from app.report.reasons import ReasonCount
from app.report.summary import CAUTERY_AT_ENTRY
from app.report.time_plot import TimePlot
from app.session import SINGLE_SOURCE


def report_html(
    summary: dict[str, Any],
    reasons: Sequence[ReasonCount],
    margin_png: bytes,
    scene_png: bytes | None,
    version: str,
    analysis: Sequence[str] = (),
    distances: TimePlot | None = None,
) -> str:
    """Return the page: values are escaped, pictures embedded; it has no links.

    ``analysis`` are the sections of `analysis_sections`. ``distances`` is the plot whose static
    picture is ``margin_png``. Without both the page has no script.
    """
    picture = _image(margin_png, "Signed distance over time")
    if distances is not None:
        picture = distances.html(picture, "Signed distance over time")
    case = str(summary["case"])
    sections = (
        _head(case, summary),
        f"<h2>Distance over time</h2>\n{picture}",
        "" if scene_png is None else _deepest(summary, scene_png),
        _breaches(summary["breaches"]),
        *analysis,
        _expected(summary["expected"]),
        '<div class="columns">',
        f"<div>{_states(summary)}{_reasons(reasons)}</div>",
        f"<div>{_margins(summary['margins'])}{_timing(summary['timing'])}</div>",
        "</div>",
        _registration(summary["registration"]),
        _notes(summary["notes"]),
        _foot(version),
    )
    return document(
        f"{case}: margin report", sections, figures=distances is not None or bool(analysis)
    )


def _head(case: str, summary: dict[str, Any]) -> str:
    provenance = "; ".join(f"{key}: {value}" for key, value in summary["provenance"].items())
    frames, valid = summary["frames"], summary["valid_frames"]
    tiles = (
        (text_of(len(summary["breaches"])), "breaches of the tumour"),
        (length(_lowest(summary)), "smallest signed distance"),
        (time_text(summary["duration_s"]), f"replayed, {frames} frames"),
        (f"{100.0 * valid / frames:.1f} %", f"of the frames valid ({valid})"),
        (_verdict(summary["expected"]), "expected results of the case"),
    )
    measured = "the tip alone (--tip-only)" if summary["tip_only"] else "the whole mesh of the tool"
    checked = f", {SINGLE_SOURCE}" if summary["single_source"] else ""
    return (
        f"<h1>{escape(case)}</h1>\n"
        f'<p class="note">{escape(provenance)}</p>\n'
        f'<p class="note">Measured: {escape(measured)}{escape(checked)}.</p>\n'
        f'<p class="device">{escape(NOT_A_DEVICE)}</p>\n<ul class="tiles">'
        + "".join(f"<li><b>{escape(big)}</b>{escape(small)}</li>" for big, small in tiles)
        + "</ul>"
    )


def _foot(version: str) -> str:
    return (
        f'<p class="note">Made by MarginGuard {escape(version)}. '
        "The numbers are in summary.json and margin.csv beside this page.</p>"
    )


def _deepest(summary: dict[str, Any], scene_png: bytes) -> str:
    distance = length(summary["min_signed_distance_mm"])
    return _picture(f"Deepest point ({distance})", scene_png, "Tumour, tool and robot")


def _picture(title: str, png: bytes, alt: str) -> str:
    return f"<h2>{escape(title)}</h2>\n{_image(png, alt)}"


def _image(png: bytes, alt: str) -> str:
    data = base64.b64encode(png).decode("ascii")
    return f'<img alt="{escape(alt)}" src="data:image/png;base64,{data}">'


def _breaches(breaches: Sequence[dict[str, Any]]) -> str:
    if not breaches:
        return '<h2>Breaches</h2>\n<p class="note">The tool was never in the tumour.</p>'
    rows = [
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
            *((breach[CAUTERY_AT_ENTRY],) if CAUTERY_AT_ENTRY in breach else ()),
        )
        for number, breach in enumerate(breaches, start=1)
    ]
    header = (
        *("breach", "from", "to", "lasted", "deepest frame"),
        *("deepest on the path", "not below", "at", "seen"),
        *(("cautery at entry",) if CAUTERY_AT_ENTRY in breaches[0] else ()),
    )
    note = (
        '<p class="note">The path between two frames is taken as straight. "between frames": the '
        "tool is outside in every frame and passed through the tumour between two of them.</p>"
    )
    return scrolling(table("Breaches", header, rows), "Breaches") + note


def _lowest(summary: dict[str, Any]) -> float | None:
    """The lowest distance of all frames and of the paths between them."""
    keys = ("min_signed_distance_mm", "path_min_signed_distance_mm")
    return min((summary[key] for key in keys if summary[key] is not None), default=None)


def _expected(checks: Sequence[dict[str, str]] | None) -> str:
    if checks is None:
        return ""
    body = "".join(
        f"<tr><td>{escape(check['check'])}</td>"
        f'<td class="{escape(check["result"])}">{escape(check["result"])}</td>'
        f"<td>{escape(check['detail'])}</td></tr>"
        for check in checks
    )
    return (
        "<h2>Expected results</h2>\n"
        f"<table><tr><th>check</th><th>result</th><th>found</th></tr>{body}</table>"
    )


def _states(summary: dict[str, Any]) -> str:
    seconds, counts = summary["state_seconds"], summary["state_counts"]
    rows = [
        (state, MarginState[state].display.description, counts[state], time_text(seconds[state]))
        for state in counts
    ]
    return table("Margin states", ("state", "meaning", "frames", "time"), rows)


def _reasons(reasons: Sequence[ReasonCount]) -> str:
    rows = [(reason.reason, reason.frames, time_text(reason.first_s)) for reason in reasons]
    return table("Reasons", ("reason", "frames", "first at"), rows)


def _margins(margins: dict[str, Any]) -> str:
    return table("Margins", ("parameter", "value"), [(k, text_of(v)) for k, v in margins.items()])


def _timing(timing: dict[str, Any]) -> str:
    rows = [(name, text_of(value)) for name, value in timing.items()]
    return table("Time of one step", ("statistic", "microseconds"), rows)


def _registration(registration: dict[str, Any] | None) -> str:
    if registration is None:
        return ""
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
    return table("Registration", ("quantity", "value"), rows, numbers=False)


def _notes(notes: Sequence[str]) -> str:
    if not notes:
        return ""
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f"<h2>Notes of the reader</h2>\n<ul>{items}</ul>"


def _verdict(checks: Sequence[dict[str, str]] | None) -> str:
    if checks is None:
        return "none given"
    passed = sum(check["result"] == "pass" for check in checks)
    return f"{passed} of {len(checks)} pass"
