"""``report.html``: the report as one file without external resources."""

from collections.abc import Sequence
from typing import Any

from markupsafe import Markup

from app.fixture import MarginState
from app.report.page import Cell, document, length, part, text_of, time_text
from app.report.reasons import ReasonCount
from app.report.summary import CAUTERY_AT_ENTRY
from app.report.time_plot import TimePlot
from app.session import SINGLE_SOURCE

_NOTHING = Markup()


def report_html(
    summary: dict[str, Any],
    reasons: Sequence[ReasonCount],
    margin_png: bytes,
    scene_png: bytes | None,
    version: str,
    analysis: Markup = _NOTHING,
    distances: TimePlot | None = None,
) -> str:
    """Return the page: values are escaped, pictures embedded; it has no links.

    ``analysis`` is that of `analysis_sections`. ``distances`` is the plot whose static picture is
    ``margin_png``. Without both the page has no script.
    """
    picture = part("picture.html", png=margin_png, alt="Signed distance over time")
    if distances is not None:
        picture = distances.html(picture, "Signed distance over time")
    measured = "the tip alone (--tip-only)" if summary["tip_only"] else "the whole mesh of the tool"
    return document(
        "report.html",
        f"{summary['case']}: margin report",
        figures=distances is not None or bool(analysis),
        summary=summary,
        provenance="; ".join(f"{key}: {value}" for key, value in summary["provenance"].items()),
        measured=measured + (f", {SINGLE_SOURCE}" if summary["single_source"] else ""),
        tiles=_tiles(summary),
        distance=picture,
        scene_png=scene_png,
        breaches=_breaches(summary["breaches"]),
        breach_header=_breach_header(summary["breaches"]),
        analysis=analysis,
        states=_states(summary),
        reasons=[(each.reason, each.frames, time_text(each.first_s)) for each in reasons],
        registration=_registration(summary["registration"]),
        version=version,
    )


def _tiles(summary: dict[str, Any]) -> Sequence[tuple[str, str]]:
    frames, valid = summary["frames"], summary["valid_frames"]
    return (
        (text_of(len(summary["breaches"])), "breaches of the tumour"),
        (length(_lowest(summary)), "smallest signed distance"),
        (time_text(summary["duration_s"]), f"replayed, {frames} frames"),
        (f"{100.0 * valid / frames:.1f} %", f"of the frames valid ({valid})"),
        (_verdict(summary["expected"]), "expected results of the case"),
    )


def _breach_header(breaches: Sequence[dict[str, Any]]) -> Sequence[str]:
    has_cautery = bool(breaches) and CAUTERY_AT_ENTRY in breaches[0]
    return (
        *("breach", "from", "to", "lasted", "deepest frame"),
        *("deepest on the path", "not below", "at", "seen"),
        *(("cautery at entry",) if has_cautery else ()),
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
            *((breach[CAUTERY_AT_ENTRY],) if CAUTERY_AT_ENTRY in breach else ()),
        )
        for number, breach in enumerate(breaches, start=1)
    ]


def _lowest(summary: dict[str, Any]) -> float | None:
    """The lowest distance of all frames and of the paths between them."""
    keys = ("min_signed_distance_mm", "path_min_signed_distance_mm")
    return min((summary[key] for key in keys if summary[key] is not None), default=None)


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


def _verdict(checks: Sequence[dict[str, str]] | None) -> str:
    if checks is None:
        return "none given"
    passed = sum(check["result"] == "pass" for check in checks)
    return f"{passed} of {len(checks)} pass"
