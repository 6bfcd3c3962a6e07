"""Files of an analysis: one JSON document, and CSV tables."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO
from typing import Any

from app.analysis import CaseAnalysis

CSV_FILES = ("analysis.csv", "breaches.csv", "coverage.csv")
_BREACH = (
    *("start_s", "end_s", "duration_s", "frames", "lowest_sample_mm", "distance_mm", "low_mm"),
    *("high_mm", "inside_probability", "entry_speed_mm_s", "direction", "side", "part"),
    *("x_mm", "y_mm", "z_mm"),
)


def analysis_document(analysis: CaseAnalysis, methods: Mapping[str, Any]) -> dict[str, Any]:
    """The analysis as JSON types, with ``methods``: version, input hashes, how it was computed."""
    return {**analysis.as_dict(), "methods": dict(methods)}


def analysis_csv(analysis: CaseAnalysis) -> dict[str, bytes]:
    """Content of each file of `CSV_FILES`; an unknown value is an empty cell.

    ``analysis.csv`` has one row, the flat record; ``breaches.csv`` one per breach; ``coverage.csv``
    one per face of the tumour's mesh that was used, with the least distance of the tool.
    """
    flat = analysis.flat()
    covered = analysis.coverage
    faces = zip(
        covered.faces.tolist(), covered.areas_mm2.tolist(), covered.nearest_mm.tolist(), strict=True
    )
    return {
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
