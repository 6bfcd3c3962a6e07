"""``report.html``: the report as one file without external resources."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from app.report.reasons import ReasonCount
from app.session import SINGLE_SOURCE

NOT_A_DEVICE = (
    "MarginGuard is research software. It is not a medical device and must not be used to treat "
    "or diagnose a patient."
)

PAGE_STYLE = """
:root { color-scheme: light; --ink: #1c2733; --line: #d5dce3; --soft: #f4f6f8; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 76rem; padding: 1.5rem; color: var(--ink);
       font: 15px/1.5 system-ui, "Segoe UI", Roboto, "Liberation Sans", sans-serif; }
h1 { margin: 0 0 .2rem; font-size: 1.7rem; }
h2 { margin: 2.2rem 0 .6rem; font-size: 1.15rem; }
p.note { margin: .2rem 0; color: #51606e; }
p.device { margin: .8rem 0 1.2rem; padding: .5rem .8rem; border-left: 4px solid #c8381e;
           background: #fdf3f0; }
ul.tiles { display: flex; flex-wrap: wrap; gap: .8rem; margin: 1rem 0; padding: 0;
           list-style: none; }
ul.tiles li { flex: 1 1 9rem; padding: .7rem .9rem; border: 1px solid var(--line);
              border-radius: 6px; background: var(--soft); }
ul.tiles b { display: block; font-size: 1.45rem; line-height: 1.2;
             font-variant-numeric: tabular-nums; }
div.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(22rem, 1fr));
              gap: 0 2.5rem; }
div.wide { overflow-x: auto; }
table { width: 100%; border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .6rem; border-bottom: 1px solid var(--line); text-align: left;
         vertical-align: top; overflow-wrap: break-word; }
th { background: var(--soft); font-weight: 600; }
td.number, th.number { text-align: right; white-space: nowrap; }
td.pass, td.fail { font-weight: 600; white-space: nowrap; }
td.pass { color: #00694c; }
td.fail { color: #a32a14; }
img { display: block; width: 100%; height: auto; border: 1px solid var(--line);
      border-radius: 6px; }
@media print { body { max-width: none; padding: 0; } h2 { break-after: avoid; } }
"""

_Cell = str | int | float | None


def report_html(
    summary: dict[str, Any],
    reasons: Sequence[ReasonCount],
    margin_png: bytes,
    scene_png: bytes | None,
    version: str,
) -> str:
    """Return the page: values are escaped, pictures embedded; it has no script and no links."""
    case = str(summary["case"])
    sections = (
        _head(case, summary),
        _picture("Distance over time", margin_png, "Signed distance over time"),
        "" if scene_png is None else _deepest(summary, scene_png),
        _breaches(summary["breaches"]),
        _expected(summary["expected"]),
        '<div class="columns">',
        f"<div>{_states(summary)}{_reasons(reasons)}</div>",
        f"<div>{_margins(summary['margins'])}{_timing(summary['timing'])}</div>",
        "</div>",
        _registration(summary["registration"]),
        _notes(summary["notes"]),
        _foot(version),
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(case)}: margin report</title>\n<style>{PAGE_STYLE}</style>\n</head>\n"
        "<body>\n" + "\n".join(section for section in sections if section) + "\n</body>\n</html>\n"
    )


def _head(case: str, summary: dict[str, Any]) -> str:
    provenance = "; ".join(f"{key}: {value}" for key, value in summary["provenance"].items())
    frames, valid = summary["frames"], summary["valid_frames"]
    tiles = (
        (_text(len(summary["breaches"])), "breaches of the tumour"),
        (_length(_lowest(summary)), "smallest signed distance"),
        (_time(summary["duration_s"]), f"replayed, {frames} frames"),
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
    distance = _length(summary["min_signed_distance_mm"])
    return _picture(f"Deepest point ({distance})", scene_png, "Tumour, tool and robot")


def _picture(title: str, png: bytes, alt: str) -> str:
    data = base64.b64encode(png).decode("ascii")
    return f'<h2>{escape(title)}</h2>\n<img alt="{escape(alt)}" src="data:image/png;base64,{data}">'


def _breaches(breaches: Sequence[dict[str, Any]]) -> str:
    if not breaches:
        return '<h2>Breaches</h2>\n<p class="note">The tool was never in the tumour.</p>'
    rows = [
        (
            number,
            _time(breach["start_s"]),
            _time(breach["end_s"]),
            _time(breach["duration_s"]),
            _length(breach["min_signed_distance_mm"]),
            _length(breach["path_min_signed_distance_mm"]),
            _length(breach["path_lower_bound_mm"]),
            "-" if breach["deepest_s"] is None else _time(breach["deepest_s"]),
            "between frames" if breach["between_frames"] else "in frames",
        )
        for number, breach in enumerate(breaches, start=1)
    ]
    header = (
        *("", "from", "to", "lasted", "deepest frame"),
        *("deepest on the path", "not below", "at", "seen"),
    )
    note = (
        '<p class="note">The path between two frames is taken as straight. "between frames": the '
        "tool is outside in every frame and passed through the tumour between two of them.</p>"
    )
    return f'<div class="wide">{_table("Breaches", header, rows)}</div>{note}'


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
    rows = [(state, counts[state], _time(seconds[state])) for state in counts]
    return _table("Margin states", ("state", "frames", "time"), rows)


def _reasons(reasons: Sequence[ReasonCount]) -> str:
    rows = [(reason.reason, reason.frames, _time(reason.first_s)) for reason in reasons]
    return _table("Reasons", ("reason", "frames", "first at"), rows)


def _margins(margins: dict[str, Any]) -> str:
    return _table("Margins", ("parameter", "value"), [(k, _text(v)) for k, v in margins.items()])


def _timing(timing: dict[str, Any]) -> str:
    rows = [(name, _text(value)) for name, value in timing.items()]
    return _table("Time of one step", ("", "microseconds"), rows)


def _registration(registration: dict[str, Any] | None) -> str:
    if registration is None:
        return ""
    rows = [
        (name, _text(registration[name]))
        for name in ("method", "accepted", "reason", "points", "fre_mm", "fle_mm")
    ]
    rows.extend(
        (name, ", ".join(_text(value) for value in registration[name]) or "-")
        for name in ("residuals_mm", "leave_one_out_mm")
    )
    matrix = registration["matrix"]
    lines = [", ".join(f"{value:.6g}" for value in matrix[at : at + 4]) for at in range(0, 16, 4)]
    rows.append((f"{registration['target']}_from_{registration['source']}", "; ".join(lines)))
    return _table("Registration", ("", "value"), rows, numbers=False)


def _notes(notes: Sequence[str]) -> str:
    if not notes:
        return ""
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f"<h2>Notes of the reader</h2>\n<ul>{items}</ul>"


def _table(
    title: str, header: Sequence[str], rows: Iterable[Sequence[_Cell]], *, numbers: bool = True
) -> str:
    """A table under its title; with ``numbers`` all columns but the first are right-aligned."""

    def cells(tag: str, values: Sequence[_Cell]) -> str:
        return "".join(
            f'<{tag} class="number">{escape(_text(value))}</{tag}>'
            if numbers and column > 0
            else f"<{tag}>{escape(_text(value))}</{tag}>"
            for column, value in enumerate(values)
        )

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f"<h2>{escape(title)}</h2>\n<table><tr>{cells('th', header)}</tr>{body}</table>"


def _verdict(checks: Sequence[dict[str, str]] | None) -> str:
    if checks is None:
        return "none given"
    passed = sum(check["result"] == "pass" for check in checks)
    return f"{passed} of {len(checks)} pass"


def _length(value_mm: float | None) -> str:
    return "-" if value_mm is None else f"{value_mm:.2f} mm"


def _time(value_s: float) -> str:
    return f"{value_s:.3f} s"


def _text(value: _Cell | bool) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
