"""The answer of a report, for its first lines: the breaches, how near elsewhere, what is unknown.

HTML and PDF have the same words.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from app.fixture import MarginState
from app.session import structure_title

if TYPE_CHECKING:
    from app.analysis import CaseAnalysis

_MAX_LISTED = 5
"""The deepest breaches are listed; the table below has all."""


@dataclass(frozen=True, slots=True)
class Answer:
    """``state`` names the display of the headline."""

    state: MarginState
    headline: str
    lines: tuple[str, ...]

    @property
    def symbol(self) -> str:
        """The symbol of the state."""
        return self.state.display.symbol


@dataclass(frozen=True, slots=True)
class _Breach:
    number: int
    depth_mm: float
    text: str


def answer(summary: Mapping[str, Any], analysis: "CaseAnalysis | None" = None) -> Answer:
    """The answer of ``summary``; with ``analysis`` also estimated depths, places and sides.

    Without a breach the state is UNKNOWN if a part of the time is.
    """
    found = _measured(summary) if analysis is None else _estimated(analysis)
    found = sorted(found, key=lambda breach: -breach.depth_mm)
    structures, unknown = summary.get("structures", ()), MarginState.UNKNOWN.name
    unknown_s = max(each["state_seconds"][unknown] for each in (summary, *structures))
    is_unknown = any(each["state_counts"][unknown] for each in (summary, *structures))
    lines = [f"Breach {each.number}: {each.text}" for each in found[:_MAX_LISTED]]
    if len(found) > _MAX_LISTED:
        lines.append(f"and {len(found) - _MAX_LISTED} less deep, in the table below")
    if analysis is not None:
        lines += _elsewhere(analysis)
    lines += [_of_structure(each) for each in structures]
    if is_unknown:
        lines.append(
            f"Unknown for {unknown_s:.1f} of {summary['duration_s']:.1f} s: a breach meanwhile is "
            "not excluded."
        )
    if found:
        noun = "breach" if len(found) == 1 else "breaches"
        headline = f"{len(found)} {noun} of the tumour, deepest {found[0].depth_mm:.1f} mm"
        return Answer(MarginState.POSITIVE, headline, tuple(lines))
    entered = [structure_title(each["name"]) for each in structures if each["breaches"]]
    if entered:
        headline = f"The tool was in {' and '.join(entered)}, never in the tumour"
        return Answer(MarginState.POSITIVE, headline, tuple(lines))
    state = MarginState.UNKNOWN if is_unknown else MarginState.NEGATIVE
    nearest = lowest_mm(summary)
    if nearest is None:
        return Answer(MarginState.UNKNOWN, "No distance is known", tuple(lines))
    headline = f"The tool was never in the tumour: nearest {nearest:.1f} mm"
    if is_unknown:
        headline = f"No breach was measured: nearest {nearest:.1f} mm"
    return Answer(state, headline, tuple(lines))


def _of_structure(structure: Mapping[str, Any]) -> str:
    """One line on a further structure."""
    name, nearest = structure_title(structure["name"]), lowest_mm(structure)
    count = len(structure["breaches"])
    if nearest is None:
        return f"{name}: no distance is known"
    if count:
        noun = "breach" if count == 1 else "breaches"
        return f"{name}: {count} {noun}, deepest {-nearest:.1f} mm"
    return f"{name}: not entered, nearest {nearest:.1f} mm"


def verdict(checks: Sequence[Mapping[str, str]] | None) -> str:
    """The number of expected results of the case that were found."""
    if checks is None:
        return "none given"
    passed = sum(check["result"] == "pass" for check in checks)
    return f"{passed} of {len(checks)} pass"


def lowest_mm(summary: Mapping[str, Any]) -> float | None:
    """The lowest distance of all frames and of the paths between them."""
    keys = ("min_signed_distance_mm", "path_min_signed_distance_mm")
    return min((summary[key] for key in keys if summary[key] is not None), default=None)


def _measured(summary: Mapping[str, Any]) -> list[_Breach]:
    """Depths as measured, which the jitter of the tracker makes too large."""
    found = []
    for number, breach in enumerate(summary["breaches"], start=1):
        low_mm = lowest_mm(breach)
        depth_mm = 0.0 if low_mm is None else max(0.0, -low_mm)
        when = _when(breach["start_s"], breach["duration_s"])
        found.append(_Breach(number, depth_mm, f"{depth_mm:.1f} mm deep as measured, {when}"))
    return found


def _estimated(analysis: "CaseAnalysis") -> list[_Breach]:
    found = []
    for number, breach in enumerate(analysis.breaches, start=1):
        estimate = breach.estimate
        depth_mm = max(0.0, -breach.lowest_sample_mm)
        depth = f"{depth_mm:.1f} mm deep as measured"
        if estimate is not None:
            depth_mm = estimate.depth_mm
            low_mm, high_mm = max(0.0, -estimate.high_mm), max(0.0, -estimate.low_mm)
            depth = f"{depth_mm:.1f} mm deep (95 %: {low_mm:.1f} to {high_mm:.1f} mm)"
        place = breach.direction or "centre"
        part = breach.part or "part of the tool not known"
        when = _when(breach.start_s, breach.duration_s)
        found.append(_Breach(number, depth_mm, f"{depth}, {place}, {part}, {when}"))
    return found


def _when(start_s: float, duration_s: float) -> str:
    return f"at {start_s:.1f} s for {duration_s:.1f} s"


def _elsewhere(analysis: "CaseAnalysis") -> Iterator[str]:
    """Yield one line on the nearest distance at each side without a breach."""
    from app.analysis.coverage import WITHIN_MM

    texts = []
    for side in analysis.sides:
        if side.breaches:
            continue
        is_measured = any(share is not None for share in side.shares.values())
        far = f"more than {WITHIN_MM[-1]:g} mm" if is_measured else "not known"
        near = far if side.nearest_mm is None else f"{side.nearest_mm:.1f} mm"
        texts.append(f"{side.side} {near}")
    if texts:
        yield f"At the other sides the tool came as near as: {', '.join(texts)}."
