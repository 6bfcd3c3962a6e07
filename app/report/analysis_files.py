"""Files of an analysis: JSON, CSV tables, and the frames as Parquet."""

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.analysis.motion import smooth_pieces
from app.geometry import NS_PER_S, FloatArray
from app.runtime import PassiveOutput, StepTiming

if TYPE_CHECKING:
    from app.analysis import BreachProbability, CaseAnalysis
    from app.analysis.breach_probability import Outcome
    from app.fixture import FixtureDecision
    from app.geometry import Transform
    from app.session import StepResult

_BREACH = (
    *("start_s", "end_s", "duration_s", "frames", "lowest_sample_mm", "distance_mm", "low_mm"),
    *("high_mm", "inside_probability", "entry_speed_mm_s", "direction", "side", "part"),
    *("x_mm", "y_mm", "z_mm"),
)

_WHATIF = (
    *("question", "source", "stop_mm", "probability", "inside_s", "lowest_p5_mm"),
    *("lowest_p50_mm", "lowest_p95_mm", "variance_share", "held_s"),
)
_XYZ = ("x", "y", "z")
FRAME_COLUMNS = (
    *("t_s", "stamp_ns", "state", "reasons", "hold", "hold_causes", "between_frames"),
    *("signed_distance_mm", "lower_bound_mm", "stop_total_mm", "warn_total_mm"),
    *(f"tip_{axis}_mm" for axis in _XYZ),
    *(f"velocity_{axis}_mm_s" for axis in _XYZ),
    *(f"on_tumor_{axis}_mm" for axis in _XYZ),
    *(f"on_tool_{axis}_mm" for axis in _XYZ),
    *(f"normal_{axis}" for axis in _XYZ),
)


def analysis_document(analysis: "CaseAnalysis", methods: Mapping[str, Any]) -> dict[str, Any]:
    """The analysis as JSON types, with ``methods``: version, input hashes, how it was computed."""
    return {**analysis.as_dict(), "methods": dict(methods)}


def analysis_csv(analysis: "CaseAnalysis") -> dict[str, bytes]:
    """Content of each file by name. An unknown value is an empty cell.

    ``analysis.csv`` has one row, the flat record; ``breaches.csv`` one per breach; ``coverage.csv``
    one per face of the tumour's mesh that was used, with the least distance of the tool;
    ``directions.csv`` one per side of the tumour;
    where errors were given, ``moments.csv`` one per frame and ``whatif.csv`` one per question.
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


def _whatif_rows(found: "BreachProbability") -> Iterable[Sequence[object]]:
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
    outcome: "Outcome",
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


def _breach_rows(analysis: "CaseAnalysis") -> Iterable[Sequence[object]]:
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


class _Row(NamedTuple):
    """Values of a step for the table; they are taken apart at the end."""

    stamp_ns: int
    decision: "FixtureDecision"
    hold_causes: tuple[str, ...]
    between_frames: bool
    tip: "Transform | None"


class FramesTable(PassiveOutput):
    """`Output` that keeps one row per step, in the tumour's frame; unknown values are null.

    ``max_gap_s``: the velocity is not known across a longer gap.
    """

    def __init__(self, max_gap_s: float) -> None:
        self._max_gap_s = max_gap_s
        self._rows: list[_Row] = []

    def publish(self, step: "StepResult", timing: StepTiming) -> bool:
        """Keep the row of ``step``."""
        step = step.of_tumor
        between_frames = step.between_frames is not None
        stamp_ns, tip = step.frame.stamp.ns, step.tumor_from_tip
        self._rows.append(_Row(stamp_ns, step.decision, step.hold_causes, between_frames, tip))
        return True

    def parquet(self) -> bytes:
        """The Parquet file: the same steps give the same bytes.

        Needs pyarrow (extra ``cohort``).
        """
        import pyarrow as pa  # slow to load, and in an extra
        import pyarrow.parquet as pq

        columns = self._columns()
        table = pa.Table.from_arrays(
            [_array(name, columns[name]) for name in FRAME_COLUMNS], names=list(FRAME_COLUMNS)
        )
        sink = pa.BufferOutputStream()
        pq.write_table(table, sink, compression="zstd")
        return bytes(sink.getvalue())

    def _columns(self) -> dict[str, Any]:
        """By name: texts, truth values, whole numbers, or floats, not finite where unknown."""
        rows = self._rows
        stamps = np.array([row.stamp_ns for row in rows], dtype=np.int64)
        times = (stamps - stamps[:1]) / NS_PER_S
        tips = _points(None if row.tip is None else row.tip.translation_mm for row in rows)
        decisions = [row.decision for row in rows]
        margins = [decision.margin for decision in decisions]
        found = [decision.proximity for decision in decisions]
        distances = _numbers(None if p is None else p.signed_distance_mm for p in found)
        columns: dict[str, Any] = {
            "t_s": times,
            "stamp_ns": stamps,
            "state": [decision.state.name for decision in decisions],
            "reasons": [";".join(map(str, decision.reasons)) for decision in decisions],
            "hold": np.array([decision.hold for decision in decisions], dtype=np.bool_),
            "hold_causes": [";".join(row.hold_causes) for row in rows],
            "between_frames": np.array([row.between_frames for row in rows], dtype=np.bool_),
            "signed_distance_mm": distances,
            "lower_bound_mm": _numbers(None if p is None else p.lower_bound_mm for p in found),
            "stop_total_mm": _numbers(None if m is None else m.total_mm for m in margins),
            "warn_total_mm": _numbers(None if m is None else m.warn_total_mm for m in margins),
        }
        for name, values in (
            ("tip_{}_mm", tips),
            ("velocity_{}_mm_s", self._velocities(times, tips)),
            ("on_tumor_{}_mm", _points(None if p is None else p.on_tumor_mm for p in found)),
            ("on_tool_{}_mm", _points(None if p is None else p.on_tool_mm for p in found)),
            ("normal_{}", _points(None if p is None else p.normal for p in found)),
        ):
            columns |= {
                name.format(axis): column for axis, column in zip(_XYZ, values.T, strict=True)
            }
        return columns

    def _velocities(self, times: FloatArray, tips: FloatArray) -> FloatArray:
        """Velocity (n, 3) of the tip by `smooth_pieces`, NaN where it is not known."""
        found = np.full((len(times), 3), np.nan)
        known = np.isfinite(tips).all(axis=1)
        for piece in smooth_pieces(times, tips, self._max_gap_s):
            within = known & (times >= piece.times_s[0]) & (times <= piece.times_s[-1])
            for axis in range(3):
                found[within, axis] = np.interp(
                    times[within], piece.times_s, piece.velocities_mm_s[:, axis]
                )
        return found


def _numbers(values: Iterable[float | None]) -> FloatArray:
    return np.array([math.nan if value is None else value for value in values], dtype=np.float64)


def _points(values: Iterable[FloatArray | None]) -> FloatArray:
    """Points (n, 3), NaN for None."""
    unknown = np.full(3, math.nan)
    points = [unknown if value is None else value for value in values]
    return np.array(points, dtype=np.float64).reshape(-1, 3)


def _array(name: str, values: Any) -> Any:
    """The column as an array of pyarrow, of its buffers: `pyarrow.array` loads pandas."""
    import pyarrow as pa

    if name in ("state", "reasons", "hold_causes"):
        texts = [text.encode() for text in values]
        ends = np.cumsum([0, *map(len, texts)], dtype=np.int32)
        buffers = [None, pa.py_buffer(ends.tobytes()), pa.py_buffer(b"".join(texts))]
        return pa.Array.from_buffers(pa.string(), len(values), buffers)
    if name in ("hold", "between_frames"):
        return pa.Array.from_buffers(pa.bool_(), len(values), [None, _bits(values)])
    if name == "stamp_ns":
        stamps = pa.py_buffer(values.tobytes())
        return pa.Array.from_buffers(pa.int64(), len(values), [None, stamps])
    known = np.isfinite(values)
    valid = None if known.all() else _bits(known)
    numbers = pa.py_buffer(np.where(known, values, 0.0).tobytes())
    return pa.Array.from_buffers(pa.float64(), len(values), [valid, numbers])


def _bits(flags: NDArray[np.bool_]) -> Any:
    import pyarrow as pa

    return pa.py_buffer(np.packbits(flags, bitorder="little").tobytes())
