"""Files of an analysis: one JSON document, and CSV tables."""

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO
from typing import Any

from app.analysis import BreachProbability, CaseAnalysis
from app.analysis.breach_probability import Outcome
from app.geometry import FloatArray

CSV_FILES = ("analysis.csv", "breaches.csv", "coverage.csv", "directions.csv")
PROBABILITY_FILES = ("moments.csv", "whatif.csv")
_BREACH = (
    *("start_s", "end_s", "duration_s", "frames", "lowest_sample_mm", "distance_mm", "low_mm"),
    *("high_mm", "inside_probability", "entry_speed_mm_s", "direction", "side", "part"),
    *("x_mm", "y_mm", "z_mm"),
)

_WHATIF = (
    *("question", "source", "stop_mm", "probability", "inside_s", "lowest_p5_mm"),
    *("lowest_p50_mm", "lowest_p95_mm", "variance_share", "held_s"),
)


def analysis_document(analysis: CaseAnalysis, methods: Mapping[str, Any]) -> dict[str, Any]:
    """The analysis as JSON types, with ``methods``: version, input hashes, how it was computed."""
    return {**analysis.as_dict(), "methods": dict(methods)}


def analysis_csv(analysis: CaseAnalysis) -> dict[str, bytes]:
    """Content of each file of `CSV_FILES`, and of `PROBABILITY_FILES` where errors were given.

    An unknown value is an empty cell.

    ``analysis.csv`` has one row, the flat record; ``breaches.csv`` one per breach; ``coverage.csv``
    one per face of the tumour's mesh that was used, with the least distance of the tool;
    ``directions.csv`` one per side of the tumour;
    ``moments.csv`` one per frame; ``whatif.csv`` one per question.
    """
    flat = analysis.flat()
    covered = analysis.coverage
    faces = zip(
        covered.faces.tolist(), covered.areas_mm2.tolist(), covered.nearest_mm.tolist(), strict=True
    )
    files = {
        "analysis.csv": _table(tuple(flat), [tuple(flat.values())]),
        "breaches.csv": _table(_BREACH, _breach_rows(analysis)),
        "coverage.csv": _table(
            ("face", "area_mm2", "nearest_mm"),
            (
                (face, area, nearest if nearest < float("inf") else None)
                for face, area, nearest in faces
            ),
        ),
    }
    files["directions.csv"] = _table(
        ("side", "area_mm2", "nearest_mm", *analysis.sides[0].shares, "breaches", "margin_mm"),
        (
            (*(s.side, s.area_mm2, s.nearest_mm), *s.shares.values(), s.breaches, s.margin_mm)
            for s in analysis.sides
        ),
    )
    found = analysis.probability
    if found is not None:
        header = ("t_s", "distance_mm", "probability")
        files["moments.csv"] = _table(
            header,
            zip(
                analysis.times_s.tolist(),
                _or_none(found.distances_mm),
                _or_none(found.moments),
                strict=True,
            ),
        )
        files["whatif.csv"] = _table(_WHATIF, _whatif_rows(found))
    return files


def _whatif_rows(found: BreachProbability) -> Iterable[Sequence[object]]:
    yield _whatif("as recorded", "", found.outcome)
    for name, effect in found.sources.items():
        share = effect.variance_share
        yield _whatif("without", name, effect.without, variance_share=share)
        yield _whatif("doubled", name, effect.doubled, variance_share=share)
    for stop in found.stops:
        yield _whatif("stop", "", stop.outcome, stop_mm=stop.stop_mm, held_s=stop.held_s)


def _whatif(
    question: str,
    source: str,
    outcome: Outcome,
    *,
    variance_share: float | None = None,
    stop_mm: float | None = None,
    held_s: float | None = None,
) -> Sequence[object]:
    return (
        *(question, source, stop_mm, outcome.probability, outcome.inside_s),
        *(*outcome.lowest_mm, variance_share, held_s),
    )


def _or_none(values: FloatArray) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in values.tolist()]


def _breach_rows(analysis: CaseAnalysis) -> Iterable[Sequence[object]]:
    for breach in analysis.breaches:
        found = breach.estimate
        depth = (
            (None,) * 4
            if found is None
            else (found.distance_mm, found.low_mm, found.high_mm, found.inside_probability)
        )
        yield (
            *(breach.start_s, breach.end_s, breach.duration_s, breach.frames),
            *(breach.lowest_sample_mm, *depth, breach.entry_speed_mm_s),
            *(breach.direction, breach.side, breach.part, *breach.on_tumor_mm),
        )


def _table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> bytes:
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(
        ["" if v is None else f"{v:.6f}" if isinstance(v, float) else v for v in row]
        for row in rows
    )
    return text.getvalue().encode()
