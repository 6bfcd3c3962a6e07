"""Text of a replay's summary for the terminal."""

from pathlib import Path
from typing import Any


def as_text(summary: dict[str, Any], report: Path | None) -> str:
    """Format ``summary`` (as in ``summary.json``) in a few lines."""
    from app.session import SINGLE_SOURCE

    lines = [
        summary["case"],
        f"  frames        {summary['frames']} ({summary['valid_frames']} valid) "
        f"in {summary['duration_s']:.3f} s",
        "  states        "
        + ", ".join(
            f"{name} {seconds:.2f} s" for name, seconds in summary["state_seconds"].items()
        ),
    ]
    nearest = summary["min_signed_distance_mm"]
    lines.append(f"  nearest       {'not known' if nearest is None else f'{nearest:.3f} mm'}")
    for number, breach in enumerate(summary["breaches"], start=1):
        lines.append(
            f"  breach {number:<6} {breach['start_s']:.3f} to {breach['end_s']:.3f} s, "
            f"deepest {breach['min_signed_distance_mm']:.3f} mm{_on_path(breach)}"
        )
    if not summary["breaches"]:
        lines.append("  breaches      none")
    if summary["single_source"]:
        lines.append(f"  checked by    {SINGLE_SOURCE}")
    if summary["registration"] is not None:
        lines.append(f"  registration  {summary['registration']['reason']}")
    lines += [
        f"  {check['result']:<13} {check['check']}: {check['detail']}"
        for check in summary["expected"] or ()
    ]
    lines += [f"  note          {note}" for note in summary["notes"]]
    if report is not None:
        lines.append(f"  report        {report / 'report.html'}")
    return "\n".join(lines)


def _on_path(breach: dict[str, Any]) -> str:
    """Where the tool is deepest between frames; empty if it is not known."""
    if breach["deepest_s"] is None:
        return ""
    seen = "; seen in no frame" if breach["between_frames"] else ""
    return (
        f"; on the path {breach['path_min_signed_distance_mm']:.3f} mm at "
        f"{breach['deepest_s']:.3f} s, not below {breach['path_lower_bound_mm']:.3f} mm{seen}"
    )
